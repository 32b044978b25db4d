#include "worker/inspect/accelerator_table.h"

#include <algorithm>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "worker/accel/traversal/thread_counts.h"
#include "worker/accelerators/recording/recorded_rays.h"
#include "worker/accelerators/shadow_cache.h"
#include "worker/accelerators/shadow_map.h"
#include "worker/accelerators/structure_accelerator.h"

namespace tessera::render {
namespace {

using accelerators::Structure;
using accelerators::StructureAccelerator;
using accelerators::TraversalStats;

/// Rays between two clock readings; consecutive ones, so that caches behave as in a render.
constexpr std::size_t kRun = 32;
constexpr std::size_t kMaxSearches = 1u << 16;

double cpu_seconds() {
  std::timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Calls trace(i) for i in [0, count), in runs spread evenly over the range, until `seconds` of CPU
/// time have passed. Returns the number of calls and the time.
template <typename Trace>
std::pair<std::int64_t, double> repeat(std::size_t count, double seconds, Trace&& trace) {
  if (count == 0) return {0, 0};
  const std::size_t runs = (count + kRun - 1) / kRun;
  std::size_t stride = runs * 5 / 8 + 1;  // visits every run if coprime to `runs`
  while (std::gcd(stride, runs) != 1) ++stride;
  std::int64_t calls = 0;
  const double start = cpu_seconds();
  double elapsed = 0;
  for (std::size_t run = 0; elapsed < seconds; run = (run + stride) % runs) {
    const std::size_t end = std::min(count, (run + 1) * kRun);
    for (std::size_t i = run * kRun; i < end; ++i) trace(i);
    calls += static_cast<std::int64_t>(end - run * kRun);
    elapsed = cpu_seconds() - start;
  }
  return {calls, elapsed};
}

/// The recorded rays and production's answers.
struct RecordedQueries {
  std::vector<Ray> closest;
  std::vector<ShadowRay> any;
  std::vector<bool> found, blocked;
  std::vector<Hit> hits;
  std::vector<Ray> visible;  // as in RecordedRays
};

bool same(const Hit& a, const Hit& b) {
  return a.t == b.t && a.id == b.id && a.b0 == b.b0 && a.b1 == b.b1 && a.b2 == b.b2;
}

RecordedQueries record_answers(RecordedRays rays, const SceneAccel& accel) {
  RecordedQueries q;
  q.closest = std::move(rays.camera);
  q.closest.insert(q.closest.end(), rays.bounces.begin(), rays.bounces.end());
  q.any = std::move(rays.shadows);
  q.visible = std::move(rays.visible);
  for (const Ray& ray : q.closest) {
    q.found.push_back(accel.closest_hit(ray, q.hits.emplace_back()));
  }
  for (const ShadowRay& shadow : q.any) q.blocked.push_back(accel.any_hit(shadow.ray));
  return q;
}

/// Measures for `seconds` and compares each answer: closest(i, work) and any(i, work) return
/// whether it is right.
template <typename Trace>
AcceleratorStats::Query measure(std::size_t count, double seconds, bool counted, Trace&& trace) {
  AcceleratorStats::Query stats;
  TraversalStats work;
  const auto [calls, elapsed] = repeat(count, seconds, [&](std::size_t i) {
    if (!trace(i, work)) ++stats.wrong;
  });
  stats.compared = std::min(calls, static_cast<std::int64_t>(count));
  if (calls == 0) return stats;
  const auto n = static_cast<double>(calls);
  stats.mrays = n / elapsed * 1e-6;
  if (!counted) return stats;
  stats.nodes = static_cast<double>(work.nodes) / n;
  stats.triangles = static_cast<double>(work.shapes) / n;
  return stats;
}

/// `closest(ray, hit, work)` and `any(shadow ray, work)` query a structure.
template <typename Closest, typename Any>
void fill(AcceleratorStats& row, const RecordedQueries& q, double seconds, bool counted,
          const Closest& closest, const Any& any) {
  row.closest =
      measure(q.closest.size(), seconds, counted, [&](std::size_t i, TraversalStats& work) {
        Hit hit;
        const bool found = closest(q.closest[i], hit, work);
        return found == q.found[i] && (!found || same(hit, q.hits[i]));
      });
  row.any = measure(q.any.size(), seconds, counted, [&](std::size_t i, TraversalStats& work) {
    return any(q.any[i], work) == q.blocked[i];
  });
}

std::unique_ptr<const SceneAccel> build_production(const Scene& scene, BuildQuality quality,
                                                   double* build_seconds) {
  const double start = cpu_seconds();
  auto accel =
      std::make_unique<const SceneAccel>(scene, sequential(), best_isa(), nullptr, quality);
  *build_seconds = cpu_seconds() - start;
  return accel;
}

/// Fills in the visits of the production structure. They are counted in its tree for AVX2.
void count_visits(const Scene& scene, BuildQuality quality, const RecordedQueries& q,
                  AcceleratorStats& row) {
  TraceOptions options;
  options.counted = true;
  const SceneAccel accel(scene, sequential(), options, nullptr, quality);
  const auto count = [](std::size_t rays, AcceleratorStats::Query& query, const auto& trace) {
    if (rays == 0) return;
    const contract::TraversalCounts before = thread_traversal_counts();
    for (std::size_t i = 0; i < rays; ++i) trace(i);
    const contract::TraversalCounts cost = thread_traversal_counts() - before;
    query.nodes = static_cast<double>(cost.nodes) / static_cast<double>(rays);
    query.triangles = static_cast<double>(cost.primitives) / static_cast<double>(rays);
  };
  Hit hit;
  count(q.closest.size(), row.closest,
        [&](std::size_t i) { accel.closest_hit(q.closest[i], hit); });
  count(q.any.size(), row.any, [&](std::size_t i) { accel.any_hit(q.any[i].ray); });
}

AcceleratorStats production_row(const SceneAccel& accel, BuildQuality quality, double build_seconds,
                                const RecordedQueries& q, double seconds) {
  AcceleratorStats row;
  row.name = std::string("wide-bvh-") + std::string(isa_name(best_isa()));
  row.title = "production";
  if (quality != BuildQuality::normal) {
    row.name += "-" + std::string(quality_name(quality));
    row.title += ", quality " + std::string(quality_name(quality));
  }
  row.build_seconds = build_seconds;
  row.memory_bytes = accel.memory_bytes();
  const TreeQuality trees = accel.tree_quality();
  row.sah = trees.sah;
  row.end_point_overlap = trees.end_point_overlap;
  fill(
      row, q, seconds, false,
      [&](const Ray& ray, Hit& hit, TraversalStats&) { return accel.closest_hit(ray, hit); },
      [&](const ShadowRay& shadow, TraversalStats&) { return accel.any_hit(shadow.ray); });
  return row;
}

AcceleratorStats cached_row(const Scene& scene, const SceneAccel& accel,
                            const AcceleratorStats& production, const RecordedQueries& q,
                            double seconds) {
  ShadowCache cache(scene, accel);
  std::vector<TriangleId> occluders;
  for (const ShadowRay& shadow : q.any) occluders.push_back(cache.find_occluder(shadow.ray));
  AcceleratorStats row = production;
  row.name += "+shadow-cache";
  row.title = "production, shadow cache";
  fill(
      row, q, seconds, false,
      [&](const Ray& ray, Hit& hit, TraversalStats&) { return accel.closest_hit(ray, hit); },
      [&](const ShadowRay& shadow, TraversalStats&) {
        const auto i = static_cast<std::size_t>(&shadow - q.any.data());
        return cache.any_hit(shadow.ray, shadow.light, shadow.depth, occluders[i]);
      });
  return row;
}

AcceleratorStats mapped_row(const Scene& scene, const SceneAccel& accel,
                            const AcceleratorStats& production, const RecordedQueries& q,
                            double seconds) {
  AcceleratorStats row = production;
  const double start = cpu_seconds();
  const ShadowMap map(scene);
  row.build_seconds += cpu_seconds() - start;
  row.memory_bytes += map.memory_bytes();
  row.name += "+shadow-map";
  row.title = "production, shadow map";
  using Answer = ShadowMap::Answer;
  fill(
      row, q, seconds, false,
      [&](const Ray& ray, Hit& hit, TraversalStats&) { return accel.closest_hit(ray, hit); },
      [&](const ShadowRay& shadow, TraversalStats&) {
        const Answer answer = map.answer(shadow.ray);
        return answer == Answer::unknown ? accel.any_hit(shadow.ray) : answer == Answer::occluded;
      });
  if (q.any.empty()) return row;
  const auto decided = std::count_if(q.any.begin(), q.any.end(), [&](const ShadowRay& shadow) {
    return map.answer(shadow.ray) != Answer::unknown;
  });
  row.any.decided = static_cast<double>(decided) / static_cast<double>(q.any.size());
  return row;
}

AcceleratorStats reference_row(const Scene& scene, const Structure& structure,
                               const RecordedQueries& q, double seconds) {
  AcceleratorStats row;
  row.name = structure.name;
  row.title = structure.title;
  const double start = cpu_seconds();
  const StructureAccelerator accel(scene, structure, q.visible);
  row.build_seconds = cpu_seconds() - start;
  row.memory_bytes = static_cast<std::int64_t>(accel.memory_bytes());
  fill(
      row, q, seconds, true,
      [&](const Ray& ray, Hit& hit, TraversalStats& work) {
        return accel.closest_hit(ray, hit, work);
      },
      [&](const ShadowRay& shadow, TraversalStats& work) {
        return accel.any_hit(shadow.ray, work);
      });
  return row;
}

/// null for a negative value.
nlohmann::json counted(double x) {
  return x < 0 ? nlohmann::json() : nlohmann::json(x);
}

nlohmann::json to_object(const AcceleratorStats::Query& query) {
  return {{"mrays_per_second", query.mrays},
          {"nodes_per_ray", counted(query.nodes)},
          {"triangles_per_ray", counted(query.triangles)},
          {"decided_per_ray", counted(query.decided)},
          {"compared", query.compared},
          {"wrong", query.wrong}};
}

}  // namespace

absl::StatusOr<AcceleratorTable> measure_accelerators(const Scene& scene,
                                                      const contract::RenderSettings& settings,
                                                      const AcceleratorRequest& request) {
  auto rays = record_rays(scene, settings);
  if (!rays.ok()) return rays.status();
  AcceleratorTable table;
  table.camera_rays = static_cast<std::int64_t>(rays->camera.size());
  table.bounce_rays = static_cast<std::int64_t>(rays->bounces.size());
  table.shadow_rays = static_cast<std::int64_t>(rays->shadows.size());
  const double seconds = request.seconds_per_query;
  double build_seconds = 0;
  const auto accel = build_production(scene, BuildQuality::normal, &build_seconds);
  const RecordedQueries q = record_answers(*std::move(rays), *accel);
  table.rows.push_back(production_row(*accel, BuildQuality::normal, build_seconds, q, seconds));
  count_visits(scene, BuildQuality::normal, q, table.rows.back());
  const AcceleratorStats production = table.rows.back();
  table.rows.push_back(cached_row(scene, *accel, production, q, seconds));
  table.rows.push_back(mapped_row(scene, *accel, production, q, seconds));
  for (const BuildQuality quality : {BuildQuality::fast, BuildQuality::high}) {
    if (!request.only.empty()) break;
    const auto other = build_production(scene, quality, &build_seconds);
    table.rows.push_back(production_row(*other, quality, build_seconds, q, seconds));
    count_visits(scene, quality, q, table.rows.back());
  }
  for (const Structure& structure : accelerators::structures()) {
    if (!request.only.empty() && request.only != structure.name) continue;
    table.rows.push_back(reference_row(scene, structure, q, seconds));
  }
  table.nearest = measure_vertex_distances(scene, kMaxSearches);
  return table;
}

std::string to_json(const AcceleratorTable& table) {
  nlohmann::json structures = nlohmann::json::array();
  for (const AcceleratorStats& row : table.rows) {
    structures.push_back({{"name", row.name},
                          {"title", row.title},
                          {"build_seconds", row.build_seconds},
                          {"memory_bytes", row.memory_bytes},
                          {"sah", counted(row.sah)},
                          {"end_point_overlap", counted(row.end_point_overlap)},
                          {"closest_hit", to_object(row.closest)},
                          {"any_hit", to_object(row.any)}});
  }
  return nlohmann::json{{"rays",
                         {{"camera", table.camera_rays},
                          {"bounce", table.bounce_rays},
                          {"shadow", table.shadow_rays}}},
                        {"structures", structures},
                        {"nearest", nlohmann::json::parse(search_cost_json(table.nearest))}}
      .dump();
}

}  // namespace tessera::render
