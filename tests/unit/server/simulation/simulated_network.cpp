#include "tests/unit/server/simulation/simulated_network.h"

#include <algorithm>
#include <chrono>
#include <iterator>

namespace tessera::server {

SimulatedNetwork::Stream SimulatedNetwork::open() {
  due_[++last_stream_] = Time{};
  return last_stream_;
}

/// Most messages arrive before the next step, some only after the sender has given up waiting.
Duration SimulatedNetwork::delay() {
  const bool is_slow = !is_calm_ && dice_.one_in(10);
  return std::chrono::milliseconds(dice_.below(is_slow ? 5000 : 150));
}

void SimulatedNetwork::send(Stream stream, Time now, std::function<void()> arrive) {
  const auto open = due_.find(stream);
  if (open == due_.end()) {
    ++events_.lost;
    return;
  }
  open->second = std::max(open->second, now + delay());
  messages_.emplace(open->second, Message{stream, ++last_number_, std::move(arrive)});
}

void SimulatedNetwork::send(Time now, std::function<void()> arrive) {
  messages_.emplace(now + delay(), Message{0, ++last_number_, std::move(arrive)});
}

void SimulatedNetwork::cut(Stream stream) {
  if (due_.erase(stream) == 0) return;
  const auto count = static_cast<int>(
      std::count_if(messages_.begin(), messages_.end(),
                    [stream](const auto& message) { return message.second.stream == stream; }));
  int kept = dice_.below(count + 1);
  for (auto it = messages_.begin(); it != messages_.end();) {
    const bool is_lost = it->second.stream == stream && --kept < 0;
    events_.lost += is_lost ? 1 : 0;
    it = is_lost ? messages_.erase(it) : std::next(it);
  }
}

void SimulatedNetwork::clear() {
  events_.lost += static_cast<int>(messages_.size());
  messages_.clear();
  due_.clear();
}

void SimulatedNetwork::deliver(Time now) {
  while (!messages_.empty() && messages_.begin()->first <= now) {
    const Message message = std::move(messages_.extract(messages_.begin()).mapped());
    if (message.number < newest_arrived_) ++events_.overtaken;
    newest_arrived_ = std::max(newest_arrived_, message.number);
    message.arrive();
  }
}

}  // namespace tessera::server
