#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::render::bench {

/// One quantity, measured for Tessera (`ours`) and for the structure it is compared with (`peer`).
struct Row {
  std::string scene, kind;
  double ours = 0, peer = 0;
  std::int64_t wrong = 0;  // rays with different hits, beyond the permitted number
};

/// All measurements of a run.
struct Figures {
  std::vector<Row> builds;   // build_s and memory_mb: lower is better
  std::vector<Row> rays;     // million rays per second by kind of rays; camera16: packets
  std::vector<Row> packets;  // Tessera's packets compared with its single rays
};

/// Returns geometric means of ours / peer by kind, above 1 where Tessera is better. "single_ray" is
/// the mean over all kinds of rays that are traced one by one.
std::map<std::string, double> geometric_means(const Figures& figures);

nlohmann::json to_json(const Figures& figures);

}  // namespace tessera::render::bench
