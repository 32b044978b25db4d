#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::render::bench {

/// One thing measured of ours and of a peer.
struct Row {
  std::string scene, kind;
  double ours = 0, peer = 0;
  std::int64_t wrong = 0;  // rays whose hits differ though they must not
};

/// What was measured.
struct Figures {
  std::vector<Row> builds;   // build_s and memory_mb: less is better
  std::vector<Row> rays;     // million rays a second by kind of rays; camera16: packets
  std::vector<Row> packets;  // the same of our packets beside our single rays
};

/// Ours over the peer by kind, above 1 where ours is better; "single_ray" over all kinds of rays
/// that are asked for one by one.
std::map<std::string, double> geometric_means(const Figures& figures);

nlohmann::json to_json(const Figures& figures);

}  // namespace tessera::render::bench
