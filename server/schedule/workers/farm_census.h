#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "server/schedule/workers/worker.h"

namespace tessera::server {

/// Counts of the working workers by what they serve (see requirement()), kept up to date one worker
/// at a time. Pure.
class FarmCensus {
 public:
  /// Sums over the workers with one tag.
  struct Count {
    std::int32_t threads = 0;
    std::map<std::string, std::int32_t> hosts, witnesses;  // workers on each, of each
  };
  /// Requires a worker that is not counted; until remove() what it serves, its threads, host and
  /// witness may not change.
  void add(const Worker& worker);
  /// Requires a worker that is counted.
  void remove(const Worker& worker);

  /// Workers with the tag; "": all. Null: there is none.
  const Count* find(const std::string& tag) const;
  /// Threads of the workers with the tag, at least 1.
  std::int32_t threads(const std::string& tag) const;
  /// Returns whether there is a worker with the tag whose witness is not among `asked`.
  bool has_witness_beyond(const std::string& tag, const std::set<std::string>& asked) const;

 private:
  void add(const std::string& tag, const Worker& worker);
  void remove(const std::string& tag, const Worker& worker);

  std::map<std::string, Count> by_tag_;
};

}  // namespace tessera::server
