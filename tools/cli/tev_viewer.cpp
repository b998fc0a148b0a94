#include "tools/cli/tev_viewer.h"

#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>
#include <utility>

namespace fieldtrace {
namespace {

using Clock = std::chrono::steady_clock;

enum PacketType : char { k_create = 4, k_update = 6 };

// How long the thread waits for the network, or for new pixels, before it looks whether it shall end.
constexpr int k_wait_milliseconds = 20;

class PacketWriter {
 public:
  PacketWriter(PacketType type, const std::string& image) {
    number(uint32_t(0));  // the size
    bytes_.push_back(char(type));
    bytes_.push_back(0);  // not to the front: the user may look at something else
    text(image);
  }
  template <class T>
  void number(T value) {
    static_assert(std::endian::native == std::endian::little);
    put(&value, sizeof(T));
  }
  void text(const std::string& value) { put(value.c_str(), value.size() + 1); }
  void channels() {
    number(int32_t(3));
    for (const char* name : {"R", "G", "B"}) text(name);
  }
  void put(const void* data, size_t size) {
    const char* const from = static_cast<const char*>(data);
    bytes_.insert(bytes_.end(), from, from + size);
  }
  std::vector<char> finish() {
    const auto size = uint32_t(bytes_.size());
    std::memcpy(bytes_.data(), &size, sizeof(size));
    return std::move(bytes_);
  }

 private:
  std::vector<char> bytes_;
};

// A connection that never blocks.
class Connection {
 public:
  Connection() = default;
  ~Connection() { close(); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool is_open() const { return socket_ >= 0; }
  void close() {
    if (socket_ >= 0) ::close(socket_);
    socket_ = -1;
  }

  // Tries the host's addresses in turn, each for `seconds`, while goes_on(). Returns the reason of a failure.
  template <class GoesOn>
  std::string open(const ViewerAddress& address, double seconds, const GoesOn& goes_on) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    const int failure = getaddrinfo(address.host.c_str(), address.port.c_str(), &hints, &found);
    if (failure != 0) return gai_strerror(failure);
    std::string reason = "it has no address";
    for (const addrinfo* a = found; a && !is_open() && goes_on(); a = a->ai_next) reason = open(*a, seconds, goes_on);
    freeaddrinfo(found);
    return reason;
  }

  // Sends what can be sent at once of [data, data + size), after waiting a moment for the network. Returns how much
  // that is; closes the connection where it is lost.
  size_t send_some(const char* data, size_t size) {
    pollfd state{socket_, short(POLLIN | (size > 0 ? POLLOUT : 0)), 0};
    if (poll(&state, 1, k_wait_milliseconds) <= 0) return 0;
    if (state.revents & (POLLIN | POLLHUP | POLLERR)) {
      char ignored[256];  // a viewer says nothing
      const ssize_t count = recv(socket_, ignored, sizeof ignored, MSG_DONTWAIT);
      if (count == 0 || (count < 0 && errno != EAGAIN && errno != EINTR)) {
        close();
        return 0;
      }
    }
    if (!(state.revents & POLLOUT)) return 0;
    const ssize_t sent = send(socket_, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent >= 0) return size_t(sent);
    if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) close();
    return 0;
  }

 private:
  template <class GoesOn>
  std::string open(const addrinfo& address, double seconds, const GoesOn& goes_on) {
    socket_ = socket(address.ai_family, address.ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, address.ai_protocol);
    if (socket_ < 0) return std::strerror(errno);
    int error = connect(socket_, address.ai_addr, address.ai_addrlen) == 0 ? 0 : errno;
    const Clock::time_point begin = Clock::now();
    while (error == EINPROGRESS) {
      pollfd state{socket_, POLLOUT, 0};
      const int ready = poll(&state, 1, k_wait_milliseconds);
      if (ready > 0) {
        socklen_t size = sizeof(error);
        if (getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size) != 0) error = errno;
      } else if (!goes_on() || std::chrono::duration<double>(Clock::now() - begin).count() > seconds) {
        error = ETIMEDOUT;
      }
    }
    if (error == 0) return {};
    close();
    return std::strerror(error);
  }

  int socket_ = -1;
};

}  // namespace

ViewerAddress parse_viewer_address(const std::string& text) {
  const size_t colon = text.rfind(':');
  const auto wrong = [&] { return UsageError("--tev " + text + ": write HOST:PORT, for example 127.0.0.1:14158"); };
  if (colon == std::string::npos || colon == 0) throw wrong();
  ViewerAddress address{text.substr(0, colon), text.substr(colon + 1)};
  int port = 0;
  const char* const end = address.port.data() + address.port.size();
  const auto [last, error] = std::from_chars(address.port.data(), end, port);
  if (error != std::errc() || last != end || port < 1 || port > 65535) throw wrong();
  std::string& host = address.host;
  if (host.front() == '[' && host.back() == ']') {
    host = host.substr(1, host.size() - 2);
  } else if (host.find(':') != std::string::npos) {
    throw wrong();
  }
  if (host.empty()) throw wrong();
  return address;
}

std::vector<char> create_packet(const std::string& image, int width, int height) {
  PacketWriter packet(k_create, image);
  packet.number(int32_t(width));
  packet.number(int32_t(height));
  packet.channels();
  return packet.finish();
}

std::vector<char> update_packet(const std::string& image, const LivePicture::Block& block) {
  PacketWriter packet(k_update, image);
  packet.channels();
  for (const int32_t value : {block.rect.x, block.rect.y, block.rect.width, block.rect.height}) packet.number(value);
  for (const int64_t offset : {0, 1, 2}) packet.number(offset);
  for (const int64_t stride : {3, 3, 3}) packet.number(stride);
  static_assert(sizeof(Rgb) == 3 * sizeof(float));
  packet.put(block.pixels.data(), block.pixels.size() * sizeof(Rgb));
  return packet.finish();
}

// Outlives the viewer where the system does not return from resolving a name.
struct TevViewer::Shared {
  ViewerAddress address;
  std::string image;
  std::shared_ptr<const LivePicture> picture;
  ViewerTimes times;

  std::mutex mutex;
  std::condition_variable changed;
  WarningSink warning;
  bool warned = false, finishing = false, abandoned = false, ended = false, sent_all = false;

  bool is_finishing() {
    const std::lock_guard lock(mutex);
    return finishing;
  }
  bool is_abandoned() {
    const std::lock_guard lock(mutex);
    return abandoned;
  }
  void warn_once(const std::string& message) {
    const std::lock_guard lock(mutex);
    if (warned || abandoned) return;
    warned = true;
    warn(warning, {}, "--tev " + address.host + ":" + address.port + ": " + message + "; the render goes on");
  }
  // Returns early if the viewer is to be finished.
  void pause(double seconds) {
    std::unique_lock lock(mutex);
    changed.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return finishing; });
  }

  void run() {
    bool all = false;
    for (bool is_first = true;; is_first = false) {
      Connection connection;
      // The picture may be finished before the first attempt is.
      const auto goes_on = [&] { return is_first ? !is_abandoned() : !is_finishing(); };
      const std::string reason = connection.open(address, times.connect, goes_on);
      if (connection.is_open()) {
        all = serve(connection);
        if (!all && !is_abandoned()) warn_once("the viewer has gone away");
      } else {
        warn_once("no viewer answers (" + reason + ")");
      }
      if (is_finishing()) break;
      pause(times.retry);
      if (is_finishing()) break;
    }
    const std::lock_guard lock(mutex);
    ended = true;
    sent_all = all;
    changed.notify_all();
  }

  // Sends until the connection is lost (returns false), or all is sent and the viewer is to be finished (true).
  bool serve(Connection& connection) {
    std::vector<char> packet = create_packet(image, picture->width(), picture->height());
    size_t sent = 0;
    std::vector<uint64_t> seen(picture->block_count(), 0);
    size_t next = 0;
    LivePicture::Block block;
    while (connection.is_open() && !is_abandoned()) {
      if (sent < packet.size()) {
        sent += connection.send_some(packet.data() + sent, packet.size() - sent);
        continue;
      }
      const bool was_finishing = is_finishing();  // what was written before that is seen below
      bool is_new = false;
      for (size_t i = 0; i < seen.size() && !is_new; ++i, next = (next + 1) % seen.size())
        is_new = picture->read(next, seen[next], block);
      if (is_new) {
        packet = update_packet(image, block);
        sent = 0;
      } else if (was_finishing) {
        return true;
      } else {
        connection.send_some(nullptr, 0);
      }
    }
    return false;
  }
};

TevViewer::TevViewer(const ViewerAddress& address, const std::string& image, std::shared_ptr<const LivePicture> picture,
                     WarningSink warning, const ViewerTimes& times)
    : shared_(std::make_shared<Shared>()) {
  shared_->address = address;
  shared_->image = image;
  shared_->picture = std::move(picture);
  shared_->warning = std::move(warning);
  shared_->times = times;
  std::thread([shared = shared_] { shared->run(); }).detach();
}

TevViewer::~TevViewer() { finish(); }

bool TevViewer::finish() {
  Shared& s = *shared_;
  std::unique_lock lock(s.mutex);
  if (s.abandoned) return s.sent_all;
  s.finishing = true;
  s.changed.notify_all();
  s.changed.wait_for(lock, std::chrono::duration<double>(s.times.finish), [&] { return s.ended; });
  s.abandoned = true;
  s.warning = nullptr;
  return s.sent_all;
}

}  // namespace fieldtrace
