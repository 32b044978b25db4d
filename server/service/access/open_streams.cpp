#include "server/service/access/open_streams.h"

#include <utility>

namespace tessera::server {

std::shared_ptr<const void> OpenStreams::add(grpc::CallbackServerContext& context,
                                             const Identity& identity) {
  auto stream = std::make_shared<Stream>(identity, context);
  std::int64_t key = 0;
  {
    const MutexLock lock(table_->mutex);
    key = ++table_->last_key;
    table_->streams[key] = {stream};
  }
  return std::shared_ptr<const void>(nullptr, [table = table_, stream, key](const void*) {
    {
      const MutexLock lock(stream->mutex);
      stream->context = nullptr;
    }
    const MutexLock lock(table->mutex);
    table->streams.erase(key);
  });
}

std::size_t OpenStreams::cut_refused(const std::function<bool(const Identity&)>& is_allowed,
                                     Time now) {
  std::vector<std::shared_ptr<Stream>> due;
  {
    const MutexLock lock(table_->mutex);
    for (auto& [key, entry] : table_->streams) {
      auto& [stream, refused_since] = entry;
      if (is_allowed(stream->identity)) {
        refused_since.reset();
      } else if (!refused_since) {
        refused_since = now;
      } else if (now - *refused_since >= kGrace) {
        due.push_back(stream);
      }
    }
  }
  // Without the table's mutex: cancelling may run callbacks of this or another stream here.
  std::size_t count = 0;
  for (const auto& stream : due) {
    const MutexLock lock(stream->mutex);
    if (stream->context == nullptr) continue;
    stream->context->TryCancel();
    ++count;
  }
  return count;
}

std::size_t OpenStreams::size() const {
  const MutexLock lock(table_->mutex);
  return table_->streams.size();
}

}  // namespace tessera::server
