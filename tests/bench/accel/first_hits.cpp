#include "tests/bench/accel/first_hits.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "contract/hilbert.h"
#include "tests/bench/accel/measure.h"
#include "tests/bench/accel/workload/item_buffer.h"
#include "tests/bench/accel/workload/pixel_orders.h"
#include "tests/bench/accel/workload/rays.h"
#include "tests/bench/accel/workload/scenes.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::bench {
namespace {

constexpr int kRounds = 3;
/// Minimum fraction of pixels for which item buffer and rays must find the same triangle. The item
/// buffer projects vertices in float, which moves edges by about 1e-4 of a pixel; if triangles are
/// smaller than pixels, more pixels differ (0.5 % in the stadium).
constexpr double kMinAgreement = 0.98;

using Order = std::vector<contract::GridPoint>;

/// Returns million rays per second in the best round.
template <typename Run>
double mrays(std::size_t rays, Run&& run) {
  double best = 1e30;
  std::int64_t hits = 0;
  for (int round = 0; round < kRounds; ++round) best = std::min(best, timed(run, 1, &hits));
  return static_cast<double>(rays) / best * 1e-6;
}

/// Returns the fraction of pixels for which rays and item buffer find the same triangle.
double agreement(const SceneAccel& accel, const std::vector<Ray>& rays, const Order& order,
                 int side, const std::vector<TriangleId>& items) {
  std::int64_t same = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    Hit hit;
    const bool found = accel.closest_hit(rays[i], hit);
    const auto at = static_cast<std::size_t>(order[i].y) * static_cast<std::size_t>(side) +
                    static_cast<std::size_t>(order[i].x);
    same += items[at] == (found ? hit.id : TriangleId{}) ? 1 : 0;
  }
  return static_cast<double>(same) / static_cast<double>(rays.size());
}

}  // namespace

nlohmann::json measure_first_hits(const std::vector<std::string>& scenes, bool quick,
                                  std::int64_t* wrong) {
  const int side = quick ? 32 : 512;
  const std::pair<const char*, Order> orders[] = {{"hilbert", contract::hilbert_curve(side, side)},
                                                  {"morton", morton_order(side)},
                                                  {"scanline", scanline_order(side)}};
  nlohmann::json rows = nlohmann::json::array();
  std::printf("%-10s", "Mrays/s");
  for (const auto& [name, order] : orders) std::printf(" %8s %9s", name, "packets");
  std::printf(" %11s %6s\n", "item buffer", "same");
  for (const std::string& name : scenes) {
    const BenchScene bench = make_scene(name, quick);
    const SceneAccel accel(bench.scene, sequential());
    nlohmann::json row = {{"scene", name}};
    std::printf("%-10s", name.c_str());
    std::vector<Ray> along;
    for (const auto& [curve, order] : orders) {
      const std::vector<Ray> rays = centre_rays(bench, side, order);
      const double single = mrays(rays.size(), [&] { return closest_hits(accel, rays); });
      const double packets = mrays(rays.size(), [&] { return closest_in_packets(accel, rays); });
      row[curve] = single;
      row[std::string(curve) + "_packets"] = packets;
      std::printf(" %8.2f %9.2f", single, packets);
      if (along.empty()) along = rays;
      const std::int64_t expected = closest_hits(accel, along);
      *wrong += std::abs(closest_hits(accel, rays) - expected) +
                std::abs(closest_in_packets(accel, rays) - expected);
    }
    std::vector<TriangleId> items;
    row["item_buffer"] = mrays(along.size(), [&] {
      items = item_buffer(bench, side).items;
      return std::int64_t{0};
    });
    const double same = agreement(accel, along, orders[0].second, side, items);
    row["item_buffer_same"] = same;
    if (same < kMinAgreement) {
      *wrong += std::llround((kMinAgreement - same) * static_cast<double>(along.size())) + 1;
    }
    std::printf(" %11.2f %6.4f\n", row["item_buffer"].get<double>(),
                row["item_buffer_same"].get<double>());
    std::fflush(stdout);
    rows.push_back(row);
  }
  return rows;
}

}  // namespace tessera::render::bench
