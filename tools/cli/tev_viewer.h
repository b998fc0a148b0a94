// Shows a picture that is being rendered in the viewer tev, by its protocol over TCP (https://github.com/Tom94/tev).
//
// A thread of its own connects, sends the blocks that have changed, and connects again where the viewer goes away; the
// renderer only writes into the LivePicture. Packets: their bytes (with these four), a type, whether to bring the
// image to the front, its name; then what the type says. Numbers are little-endian, texts end with a zero.
// Thread-safety: made and ended by one thread; create_packet() and update_packet() are pure.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/platform/error.h"
#include "tools/cli/live_picture.h"

namespace fieldtrace {

struct ViewerAddress {
  std::string host, port;
};

// "HOST:PORT", an IPv6 address in brackets. Throws UsageError unless PORT is a number from 1 to 65535.
ViewerAddress parse_viewer_address(const std::string& text);

// The packet that makes an image with channels R, G, B.
std::vector<char> create_packet(const std::string& image, int width, int height);
// The packet that sets these of a rectangle's pixels.
std::vector<char> update_packet(const std::string& image, const LivePicture::Block& block);

struct ViewerTimes {
  double connect = 2.0;  // seconds after which a viewer that does not answer is given up,
  double retry = 2.0;    // and after which it is tried again
  double finish = 2.0;   // that finish() may take
};

class TevViewer {
 public:
  // `image`: its name in the viewer. The first failure to connect, or the first loss of the viewer, is told by
  // `warning` from another thread.
  TevViewer(const ViewerAddress& address, const std::string& image, std::shared_ptr<const LivePicture> picture,
            WarningSink warning, const ViewerTimes& times = {});
  ~TevViewer();
  TevViewer(const TevViewer&) = delete;
  TevViewer& operator=(const TevViewer&) = delete;

  // Sends what is left, if there is a viewer that takes it in time. No warning comes later. Returns whether the viewer
  // was sent everything.
  bool finish();

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;
};

}  // namespace fieldtrace
