#pragma once

#include "server/service/streams/stream_link.h"
#include "server/telemetry/event_log.h"

namespace tessera::server {

/// Wakes a stream, a PollingStream, when the event log has news, until the stream is done.
template <typename Stream>
class StreamReader final : public EventReader {
 public:
  explicit StreamReader(Stream& stream) : link_(stream) {}
  void wake() override {
    link_.with([](Stream& stream) { stream.wake(); });
  }
  /// Call before the stream is deleted, without locks.
  void detach() { link_.detach(); }

 private:
  StreamLink<Stream> link_;
};

}  // namespace tessera::server
