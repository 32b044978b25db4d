#include "tests/bench/accel/figures.h"

#include <cmath>
#include <utility>

namespace tessera::render::bench {

std::map<std::string, double> geometric_means(const Figures& figures) {
  std::map<std::string, std::pair<double, int>> sums;
  const auto add = [&](const std::string& key, double ratio) {
    sums[key].first += std::log(ratio);
    ++sums[key].second;
  };
  for (const Row& row : figures.builds) add(row.kind, row.peer / row.ours);
  for (const Row& row : figures.packets) add(row.kind, row.ours / row.peer);
  for (const Row& row : figures.rays) {
    add(row.kind, row.ours / row.peer);
    if (row.kind != "camera16") add("single_ray", row.ours / row.peer);
  }
  std::map<std::string, double> means;
  for (const auto& [key, sum] : sums) means[key] = std::exp(sum.first / sum.second);
  return means;
}

nlohmann::json to_json(const Figures& figures) {
  nlohmann::json out;
  for (const Row& row : figures.builds) {
    out["builds"].push_back({{"scene", row.scene},
                             {"figure", row.kind},
                             {"ours", row.ours},
                             {"embree", row.peer},
                             {"ratio", row.peer / row.ours}});
  }
  for (const Row& row : figures.rays) {
    out["rays"].push_back({{"scene", row.scene},
                           {"kind", row.kind},
                           {"ours_mrays", row.ours},
                           {"embree_mrays", row.peer},
                           {"ratio", row.ours / row.peer}});
  }
  for (const Row& row : figures.packets) {
    out["packets"].push_back({{"scene", row.scene},
                              {"kind", row.kind},
                              {"packet_mrays", row.ours},
                              {"single_mrays", row.peer},
                              {"ratio", row.ours / row.peer}});
  }
  out["geometric_means"] = geometric_means(figures);
  return out;
}

}  // namespace tessera::render::bench
