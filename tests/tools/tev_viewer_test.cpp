// What a viewer is sent, against a small one that decodes the packets; and viewers that are slow, gone or never there.
#include "tools/cli/tev_viewer.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <atomic>
#include <cstring>
#include <random>

#include "core/image/image.h"
#include "hybrid/render/render.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/command_files.h"
#include "tests/support/small_scenes.h"
#include "tests/support/warnings.h"

namespace fieldtrace::test {
namespace {

// Takes packets apart. Throws std::out_of_range where one is too short.
class PacketReader {
 public:
  explicit PacketReader(std::string bytes) : bytes_(std::move(bytes)) {}
  template <class T>
  T number() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::string text() {
    const size_t end = bytes_.find('\0', at_);
    if (end == std::string::npos) throw std::out_of_range("a text without end");
    const std::string value = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return value;
  }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  std::string take(size_t size) {
    if (at_ + size > bytes_.size()) throw std::out_of_range("a packet that is too short");
    at_ += size;
    return bytes_.substr(at_ - size, size);
  }
  std::string bytes_;
  size_t at_ = 0;
};

// What a viewer knows of an image after some packets.
struct ShownImage {
  std::string name;
  int width = 0, height = 0, creations = 0, updates = 0;
  std::vector<Rgb> pixels;

  void take(const std::string& packet) {
    PacketReader p(packet);
    ASSERT_EQ(p.number<uint32_t>(), packet.size());
    const int type = p.number<char>();
    EXPECT_EQ(p.number<char>(), 0);  // stays in the background
    const std::string of = p.text();
    if (type == 4) {
      name = of;
      width = p.number<int32_t>(), height = p.number<int32_t>();
      pixels.assign(size_t(width) * size_t(height), Rgb(0.0f));
      ++creations;
    }
    ASSERT_EQ(p.number<int32_t>(), 3);
    for (const char* channel : {"R", "G", "B"}) EXPECT_EQ(p.text(), channel);
    if (type != 4) {
      ASSERT_EQ(type, 6);
      ASSERT_EQ(of, name);
      const int x = p.number<int32_t>(), y = p.number<int32_t>(), w = p.number<int32_t>(), h = p.number<int32_t>();
      ASSERT_TRUE(x >= 0 && y >= 0 && w > 0 && h > 0 && x + w <= width && y + h <= height);
      for (const int64_t offset : {0, 1, 2}) EXPECT_EQ(p.number<int64_t>(), offset);
      for (int c = 0; c < 3; ++c) EXPECT_EQ(p.number<int64_t>(), 3);
      for (int i = 0; i < w * h; ++i) {
        Rgb& to = pixels[size_t(y + i / w) * size_t(width) + size_t(x + i % w)];
        for (int c = 0; c < 3; ++c) to[c] = p.number<float>();
      }
      ++updates;
    }
    EXPECT_TRUE(p.at_end());
  }
};

// A viewer on a port of this machine. It takes one connection after another.
class Viewer {
 public:
  // Buffers of the system are small, so that a viewer that reads nothing is noticed.
  Viewer() {
    listening_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int one = 1, small = 4096;
    setsockopt(listening_, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    setsockopt(listening_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(bind(listening_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listening_, 4), 0);
    EXPECT_EQ(getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
  }
  ~Viewer() {
    hang_up();
    stop_listening();
  }
  ViewerAddress address() const { return {"127.0.0.1", std::to_string(port_)}; }

  // False if nobody comes within 20 s.
  bool accept_one() {
    pollfd state{listening_, POLLIN, 0};
    if (poll(&state, 1, 20000) <= 0) return false;
    connection_ = accept(listening_, nullptr, nullptr);
    return connection_ >= 0;
  }
  // Reads packets until the other side hangs up, or `most` of them. False if it says nothing for 20 s.
  bool read(ShownImage& image, int most = 1 << 30) {
    for (int count = 0; count < most; ++count) {
      std::string packet;
      if (!read_bytes(packet, 4)) return packet.empty() && !timed_out_;
      uint32_t size = 0;
      std::memcpy(&size, packet.data(), sizeof size);
      if (size < 4 || !read_bytes(packet, size)) return false;
      image.take(packet);
      if (testing::Test::HasFatalFailure()) return false;
    }
    return true;
  }
  void hang_up() {
    if (connection_ >= 0) close(connection_);
    connection_ = -1;
  }
  void stop_listening() {
    if (listening_ >= 0) close(listening_);
    listening_ = -1;
  }

 private:
  bool read_bytes(std::string& bytes, size_t size) {
    while (bytes.size() < size) {
      pollfd state{connection_, POLLIN, 0};
      timed_out_ = poll(&state, 1, 20000) <= 0;
      if (timed_out_) return false;
      char buffer[65536];
      const ssize_t count = recv(connection_, buffer, std::min(sizeof buffer, size - bytes.size()), 0);
      if (count <= 0) return false;
      bytes.append(buffer, size_t(count));
    }
    return true;
  }

  int listening_ = -1, connection_ = -1, port_ = 0;
  bool timed_out_ = false;
};

// Patience that no busy machine exceeds.
ViewerTimes patient() { return {.connect = 20.0, .retry = 0.01, .finish = 60.0}; }

Scene lit_floor(int balls) {
  SceneMaker maker;
  maker.film(150, 101);
  const uint32_t grey = maker.bsdf(BsdfKind::diffuse, Rgb(0.5f, 0.4f, 0.3f));
  maker.instance(maker.shape(ShapeKind::rectangle), grey, scaling(Vec3(10.0f)));
  const uint32_t ball = maker.shape(ShapeKind::sphere);
  for (int i = 0; i < balls; ++i) maker.instance(ball, grey, translation({0.4f * float(i), 0.3f * float(i), 1}));
  maker.light(EmitterKind::point, Rgb(30.0f), {2, 2, 5});
  maker.scene.camera.to_world = look_at({0, -8, 4}, {0, 0, 1}, {0, 0, 1});
  return maker.scene;
}

std::vector<Rgb> pixels_of(const Image& image) {
  std::vector<Rgb> pixels;
  for (size_t i = 0; i < image.data.size(); i += image.channel_count())
    pixels.emplace_back(image.data[i], image.data[i + 1], image.data[i + 2]);
  return pixels;
}

// Renders of one pass, by rounds, of a window, and of whole tiles around a window: what the viewer shows in the end is
// the picture, bit for bit.
TEST(TevViewer, ShowsThePicture) {
  std::vector<RenderOptions> cases(4);
  for (RenderOptions& o : cases) {
    o.method = Method::monte_carlo;
    o.spp = 2;
    o.threads = 2;
  }
  cases[1].crop = Rect{21, 13, 90, 70};
  cases[2].target_error = 0.02f;
  cases[2].spp = 0;
  cases[2].crop = Rect{5, 7, 75, 66};
  cases[2].aovs = {"depth"};
  cases[3].crop = Rect{41, 35, 50, 40};
  for (const RenderOptions& o : cases) {
    SCOPED_TRACE(&o - cases.data());
    const Scene scene = lit_floor(&o == &cases[3] ? int(k_most_candidates) : 1);
    Viewer viewer;
    ShownImage shown;
    const Rect window = o.crop.value_or(Rect{0, 0, 150, 101});
    const auto live = std::make_shared<LivePicture>(window.width, window.height);
    Warnings warnings;
    RenderCallbacks callbacks;
    callbacks.tile = [&](const Rect& tile, std::span<const Rgb> pixels) { live->update(tile, pixels); };
    TevViewer sender(viewer.address(), "picture", live, warnings.sink(), patient());
    std::atomic<bool> understood = false;
    std::thread reader([&] { understood = viewer.accept_one() && viewer.read(shown); });
    const Image image = render(scene, o, callbacks).image;
    EXPECT_TRUE(sender.finish());
    reader.join();
    EXPECT_TRUE(understood);
    EXPECT_EQ(warnings.count(), 0u);
    EXPECT_EQ(shown.name, "picture");
    EXPECT_EQ(shown.creations, 1);
    ASSERT_EQ(shown.width, image.width);
    ASSERT_EQ(shown.height, image.height);
    EXPECT_EQ(shown.pixels, pixels_of(image));
  }
}

std::vector<Rgb> pixels_of(const LivePicture& picture) {
  std::vector<Rgb> pixels(size_t(picture.width()) * size_t(picture.height()), Rgb(0.0f));
  LivePicture::Block block;
  for (size_t b = 0; b < picture.block_count(); ++b) {
    uint64_t seen = 0;
    if (!picture.read(b, seen, block)) continue;
    for (int i = 0; i < block.rect.width * block.rect.height; ++i) {
      const int x = block.rect.x + i % block.rect.width, y = block.rect.y + i / block.rect.width;
      pixels[size_t(y) * size_t(picture.width()) + size_t(x)] = block.pixels[size_t(i)];
    }
  }
  return pixels;
}

// A picture that goes on from a checkpoint shows what that holds, also where nothing is left to do.
TEST(LivePicture, ShowsWhatIsResumed) {
  const TemporaryFolder folder;
  const Scene scene = lit_floor(1);
  RenderOptions o;
  o.method = Method::monte_carlo;
  o.spp = 2;
  o.threads = 2;
  o.checkpoint = folder / "a.checkpoint";
  const Image image = render(scene, o).image;
  o.resume = o.checkpoint;
  LivePicture live(150, 101);
  RenderCallbacks callbacks;
  callbacks.tile = [&](const Rect& tile, std::span<const Rgb> pixels) { live.update(tile, pixels); };
  EXPECT_EQ(render(scene, o, callbacks).image.data, image.data);
  EXPECT_EQ(pixels_of(live), pixels_of(image));
}

// Random tiles of a picture.
struct Painter {
  std::shared_ptr<LivePicture> live;
  std::vector<Rgb> expected;
  std::mt19937 rng{5};

  explicit Painter(int width, int height)
      : live(std::make_shared<LivePicture>(width, height)), expected(size_t(width) * size_t(height), Rgb(0.0f)) {}

  void paint(int tiles) {
    for (int i = 0; i < tiles; ++i) {
      const auto below = [&](int n) { return std::uniform_int_distribution(0, n - 1)(rng); };
      Rect tile{below(live->width()), below(live->height()), 1, 1};
      tile.width += below(std::min(live->width() - tile.x, 40));
      tile.height += below(std::min(live->height() - tile.y, 40));
      std::vector<Rgb> pixels;
      for (int p = 0; p < tile.width * tile.height; ++p) {
        pixels.emplace_back(float(below(1000)), float(i), 1.0f);
        expected[size_t(tile.y + p / tile.width) * size_t(live->width()) + size_t(tile.x + p % tile.width)] =
            pixels.back();
      }
      live->update(tile, pixels);
    }
  }
};

// Finishes while the viewer reads.
void finish_and_read(TevViewer& sender, Viewer& viewer, ShownImage& shown) {
  std::atomic<bool> understood = false;
  std::thread reader([&] { understood = viewer.read(shown); });
  EXPECT_TRUE(sender.finish());
  reader.join();
  EXPECT_TRUE(understood);
}

// The viewer reads nothing until all is painted, more than the system keeps for it; then what it is sent is new.
TEST(TevViewer, ASlowViewerHoldsNothingUpAndIsSentTheNewestPixels) {
  Painter painter(2000, 1500);
  Viewer viewer;
  Warnings warnings;
  TevViewer sender(viewer.address(), "a", painter.live, warnings.sink(), patient());
  ASSERT_TRUE(viewer.accept_one());
  for (int round = 0; round < 3; ++round) {  // of 36 MB
    const std::vector<Rgb> all(2000 * 1500, Rgb(float(round)));
    painter.live->update({0, 0, 2000, 1500}, all);
    painter.expected = all;
  }
  painter.paint(5000);
  ShownImage shown;
  finish_and_read(sender, viewer, shown);
  EXPECT_EQ(warnings.count(), 0u);
  EXPECT_TRUE(shown.pixels == painter.expected);
  // A block at a time, once but for those that were on their way.
  EXPECT_LT(shown.updates, 2 * int(painter.live->block_count()));
}

TEST(TevViewer, AViewerThatReadsNothingIsGivenUp) {
  Painter painter(2000, 1500);
  Viewer viewer;
  Warnings warnings;
  TevViewer sender(viewer.address(), "a", painter.live, warnings.sink(), {.finish = 0.05});
  ASSERT_TRUE(viewer.accept_one());
  painter.live->update({0, 0, 2000, 1500}, std::vector<Rgb>(2000 * 1500, Rgb(1.0f)));
  EXPECT_FALSE(sender.finish());
  EXPECT_EQ(warnings.count(), 0u);
}

// It is sent everything again when it is back. One warning tells that it was gone.
TEST(TevViewer, AViewerThatComesBackIsSentEverythingAgain) {
  Painter painter(500, 400);
  Viewer viewer;
  Warnings warnings;
  TevViewer sender(viewer.address(), "a", painter.live, warnings.sink(), patient());
  for (int visit = 0; visit < 3; ++visit) {
    ShownImage shown;
    ASSERT_TRUE(viewer.accept_one());
    painter.paint(500);
    ASSERT_TRUE(viewer.read(shown, 5));
    viewer.hang_up();
  }
  ASSERT_TRUE(viewer.accept_one());
  painter.paint(3);
  ShownImage shown;
  finish_and_read(sender, viewer, shown);
  EXPECT_EQ(shown.creations, 1);
  EXPECT_EQ(shown.pixels, painter.expected);
  ASSERT_EQ(warnings.count(), 1u);
  EXPECT_NE(warnings.texts[0].find("has gone away; the render goes on"), std::string::npos) << warnings.texts[0];
}

TEST(TevViewer, AViewerThatIsNeverThereIsToldOfOnce) {
  Viewer viewer;
  const ViewerAddress address = viewer.address();
  viewer.stop_listening();
  Painter painter(100, 100);
  Warnings warnings;
  TevViewer sender(address, "a", painter.live, warnings.sink(), {.retry = 0.01});
  painter.paint(10);
  ASSERT_TRUE(warnings.wait());
  painter.paint(10);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // for more attempts
  EXPECT_FALSE(sender.finish());
  ASSERT_EQ(warnings.count(), 1u);
  EXPECT_NE(warnings.texts[0].find("--tev " + address.host + ":" + address.port + ": no viewer answers"),
            std::string::npos)
      << warnings.texts[0];
}

TEST(TevViewer, AddressesAreChecked) {
  const auto both = [](const std::string& text) {
    const ViewerAddress a = parse_viewer_address(text);
    return a.host + " " + a.port;
  };
  EXPECT_EQ(both("127.0.0.1:14158"), "127.0.0.1 14158");
  EXPECT_EQ(both("desk.example:1"), "desk.example 1");
  EXPECT_EQ(both("[::1]:65535"), "::1 65535");
  for (const char* text : {"", "host", ":1", "host:", "host:0", "host:65536", "host:1x", "host:-1", "::1:80", "[]:80"})
    EXPECT_THROW(parse_viewer_address(text), UsageError) << text;
}

using TevCommand = CommandFiles;

TEST_F(TevCommand, ShowsWhatIsWritten) {
  Viewer viewer;
  ShownImage shown;
  std::atomic<bool> understood = false;
  std::thread reader([&] { understood = viewer.accept_one() && viewer.read(shown); });
  const ViewerAddress a = viewer.address();
  const Outcome o = run({"render", "scene.xml", "-o", "a.exr", "--float32", "--quiet", "--tev", a.host + ":" + a.port});
  reader.join();
  EXPECT_EQ(o.code, 0) << o.err;
  EXPECT_EQ(o.err, "");
  EXPECT_TRUE(understood);
  EXPECT_EQ(shown.name, "a.exr");
  const Image image = read_image(folder_ / "a.exr");
  ASSERT_EQ(shown.pixels.size(), size_t(image.width) * size_t(image.height));
  for (int i = 0; i < image.width * image.height; ++i) {
    const float* const p = image.pixel(i % image.width, i / image.width);
    const char* const names[] = {"R", "G", "B"};
    for (int c = 0; c < 3; ++c) ASSERT_EQ(shown.pixels[size_t(i)][c], p[image.channel_index(names[c])]);
  }
}

TEST_F(TevCommand, ARenderWithoutItsViewerWarnsAndIsTheSame) {
  Viewer viewer;
  const ViewerAddress a = viewer.address();
  viewer.stop_listening();
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--quiet"}).code, 0);
  const Outcome o = run({"render", "scene.xml", "-o", "b.exr", "--quiet", "--tev", a.host + ":" + a.port});
  EXPECT_EQ(o.code, 0);
  EXPECT_EQ(o.err.rfind("fieldtrace: warning: --tev ", 0), 0u) << o.err;
  EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1) << o.err;
  EXPECT_EQ(read_image(folder_ / "a.exr").data, read_image(folder_ / "b.exr").data);
  expect_failure(2, "write HOST:PORT", {"render", "scene.xml", "-o", "a.exr", "--tev", "localhost"});
}

}  // namespace
}  // namespace fieldtrace::test
