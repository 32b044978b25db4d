#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace tessera::bench {

/// Latencies by name of the RPC, and how many calls failed. Thread-safe.
class Figures {
 public:
  void add(const std::string& rpc, double seconds, bool is_ok) {
    const std::lock_guard lock(mutex_);
    Calls& calls = calls_[rpc];
    calls.seconds.push_back(seconds);
    calls.failed += is_ok ? 0 : 1;
  }
  void print() {
    printf("{");
    const char* separator = "";
    for (auto& [rpc, calls] : calls_) {
      std::sort(calls.seconds.begin(), calls.seconds.end());
      const auto at = [&values = calls.seconds](double share) {
        const auto index = static_cast<std::size_t>(share * static_cast<double>(values.size()));
        return 1e3 * values[std::min(index, values.size() - 1)];
      };
      printf("%s\"%s\": {\"calls\": %zu, \"failed\": %d, \"p50_ms\": %.2f, \"p99_ms\": %.2f}",
             separator, rpc.c_str(), calls.seconds.size(), calls.failed, at(0.5), at(0.99));
      separator = ", ";
    }
    printf("}\n");
  }

 private:
  struct Calls {
    std::vector<double> seconds;
    int failed = 0;
  };
  std::mutex mutex_;
  std::map<std::string, Calls> calls_;
};

/// Measures `call`, which returns a status or a value with one. Returns whether it succeeded.
template <typename Call>
bool timed(Figures& figures, const char* rpc, const Call& call) {
  const auto start = std::chrono::steady_clock::now();
  const auto result = call();
  const bool is_ok = result.ok();
  figures.add(rpc, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(),
              is_ok);
  return is_ok;
}

}  // namespace tessera::bench
