// Rays per second of Tessera's BVHs and of Embree, in one process, on one thread, in CPU time.
//
//   tessera-bench-accel --peer embree [--json [FILE]] [--quick] [--scene NAME]... [--rounds N]
//   tessera-bench-accel --agreement 10000000 [--brute 100000] [--references] [--quick]
//   tessera-bench-accel --growth | --first-hits
//
// Scenes and rays are generated (scenes.h, rays.h). In every round, Embree is measured immediately
// before and after Tessera; each figure is the best of its measurements. A measurement fails if
// packets and single rays find different numbers of hits, or if Embree's number differs by more
// than kPeerMisses.
//
// --agreement traces the given number of rays, divided among the scenes, with every instruction
// set, some of the rays also by brute force and, with --references, all of them also by the
// structures of worker/accelerators. It fails if any hit differs in any bit.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/bench/accel/agreement.h"
#include "tests/bench/accel/embree_peer.h"
#include "tests/bench/accel/figures.h"
#include "tests/bench/accel/first_hits.h"
#include "tests/bench/accel/growth.h"
#include "tests/bench/accel/measure.h"
#include "tests/bench/accel/workload/rays.h"
#include "tests/bench/accel/workload/scenes.h"
#include "worker/accel/scene_accel.h"
#include "worker/render/frame_renderer.h"

namespace tessera::render::bench {
namespace {

/// Minimum number of rays in a measurement; smaller sets are traced repeatedly.
constexpr std::size_t kMinRays = 400'000;

/// Fraction of rays for which Embree may have another result, because they pass an edge within the
/// rounding error. The quick scenes have no such rays.
constexpr double kPeerMisses = 1e-3;

/// Maximum number of triangle tests by brute force in a scene, which take half a minute.
constexpr std::int64_t kBruteTests = 3'000'000'000;

struct Options {
  std::string peer = "embree", json, isa{isa_name(best_isa())}, quality = "default";
  std::vector<std::string> scenes, kinds;  // empty: all
  bool quick = false, growth = false, depth = false, first_hits = false, references = false;
  int rounds = 4, side = 512;
  std::int64_t agreement = 0, brute = 100'000;
};

BuildQuality quality_named(const std::string& name) {
  for (const BuildQuality quality : kBuildQualities) {
    if (quality_name(quality) == name) return quality;
  }
  return BuildQuality::normal;
}

/// Measures both twice per round, the peer before and after ours, and keeps the best times. Sets
/// row.wrong to the amount by which the numbers of hits differ beyond `allowed`.
template <typename Ours, typename Peer>
Row compare(const Options& options, Row row, std::size_t rays, std::int64_t allowed, Ours&& ours,
            Peer&& peer) {
  double ours_best = 1e30, peer_best = 1e30;
  std::int64_t ours_hits = 0, peer_hits = 0;
  const std::size_t runs = 1 + kMinRays / std::max<std::size_t>(rays, 1);
  for (int round = 0; round < options.rounds; ++round) {
    peer_best = std::min(peer_best, timed(peer, runs, &peer_hits));
    ours_best = std::min(ours_best, timed(ours, runs, &ours_hits));
    ours_best = std::min(ours_best, timed(ours, runs, &ours_hits));
    peer_best = std::min(peer_best, timed(peer, runs, &peer_hits));
  }
  row.ours = static_cast<double>(rays) / ours_best * 1e-6;
  row.peer = static_cast<double>(rays) / peer_best * 1e-6;
  row.wrong = std::max<std::int64_t>(std::abs(peer_hits - ours_hits) - allowed, 0);
  std::printf("%-10s %-15s %8zu rays %7.2f %7.2f Mrays/s  x%.2f   hits %lld, peer %+lld\n",
              row.scene.c_str(), row.kind.c_str(), rays, row.ours, row.peer, row.ours / row.peer,
              static_cast<long long>(ours_hits), static_cast<long long>(peer_hits - ours_hits));
  std::fflush(stdout);
  return row;
}

void run_scene(const Options& options, const std::string& name, Figures& figures) {
  const BenchScene bench = make_scene(name, options.quick);
  double start = cpu_seconds();
  const EmbreePeer peer(bench.scene);
  const double peer_seconds = cpu_seconds() - start;
  start = cpu_seconds();
  const SceneAccel accel(bench.scene, sequential(), *parse_isa(options.isa), nullptr,
                         quality_named(options.quality));
  const double ours_seconds = cpu_seconds() - start;
  figures.builds.push_back({name, "build_s", ours_seconds, peer_seconds});
  figures.builds.push_back({name, "memory_mb", static_cast<double>(accel.memory_bytes()) * 1e-6,
                            static_cast<double>(peer.memory_bytes()) * 1e-6});
  const TreeQuality quality = accel.tree_quality();
  std::printf(
      "%-10s %lld triangles: build %.2f s, peer %.2f s; %.1f MB, peer %.1f MB; SAH %.2f, end-point "
      "overlap %.3f\n",
      name.c_str(), static_cast<long long>(triangle_count(bench.scene)), ours_seconds, peer_seconds,
      figures.builds.back().ours, figures.builds.back().peer, quality.sah,
      quality.end_point_overlap);
  for (const RaySet& set : make_rays(bench, accel, options.quick ? 32 : options.side)) {
    if (!options.kinds.empty() &&
        std::find(options.kinds.begin(), options.kinds.end(), set.kind) == options.kinds.end()) {
      continue;
    }
    const auto ours = [&] {
      return set.any ? any_hits(accel, set.rays) : closest_hits(accel, set.rays);
    };
    const auto peer_misses =
        static_cast<std::int64_t>(kPeerMisses * static_cast<double>(set.rays.size()));
    figures.rays.push_back(
        compare(options, {name, set.kind}, set.rays.size(), peer_misses, ours,
                [&] { return set.any ? peer.any_hits(set.rays) : peer.closest_hits(set.rays); }));
    const auto in_packets = [&] {
      return set.any ? any_in_packets(accel, set.rays) : closest_in_packets(accel, set.rays);
    };
    if (set.camera) {
      figures.rays.push_back(compare(options, {name, set.kind + "16"}, set.rays.size(), peer_misses,
                                     in_packets, [&] { return peer.closest_hits_16(set.rays); }));
    }
    figures.packets.push_back(
        compare(options, {name, set.kind + " packets"}, set.rays.size(), 0, in_packets, ours));
  }
}

/// Returns the number of triangles of all instances.
std::int64_t placed_triangles(const BenchScene& bench) {
  std::int64_t count = 0;
  for (const Instance& instance : bench.scene.instances) {
    for (const Primitive& p :
         bench.scene.meshes[static_cast<std::size_t>(instance.mesh)].primitives) {
      count += static_cast<std::int64_t>(p.triangles.size());
    }
  }
  return count;
}

/// Returns the exit code: 1 if any two structures differ.
int check_agreement(const Options& options, const std::vector<std::string>& scenes) {
  std::int64_t wrong = 0;
  for (const std::string& name : scenes) {
    const std::int64_t rays = options.agreement / static_cast<std::int64_t>(scenes.size());
    const BenchScene bench = make_scene(name, options.quick);
    const std::int64_t brute =
        std::min(options.brute, kBruteTests / std::max<std::int64_t>(1, placed_triangles(bench)));
    const Agreement result = compare_structures(bench, {rays, brute, options.references});
    std::printf("%-10s %lld structures, %lld rays, %lld by brute force: %lld hits, %lld differ\n",
                name.c_str(), static_cast<long long>(result.structures),
                static_cast<long long>(result.rays), static_cast<long long>(result.brute_rays),
                static_cast<long long>(result.hits), static_cast<long long>(result.wrong));
    std::fflush(stdout);
    wrong += result.wrong;
  }
  return wrong == 0 ? 0 : 1;
}

int write(const Options& options, const nlohmann::json& figures) {
  if (options.json.empty()) return 0;
  if (options.json == "-") {
    std::printf("%s\n", figures.dump(2).c_str());
    return 0;
  }
  std::ofstream file(options.json);
  file << figures.dump(1) << '\n';
  return file.good() ? 0 : 1;
}

/// Writes the figures and returns the exit code: 1 if rays have wrong hits.
int finish(const Options& options, const nlohmann::json& figures, std::int64_t wrong) {
  const int written = write(options, figures);
  if (wrong == 0) return written;
  std::fprintf(stderr, "tessera-bench-accel: %lld rays with wrong hits\n",
               static_cast<long long>(wrong));
  return 1;
}

int run(const Options& options) {
  const std::vector<std::string> scenes = options.scenes.empty() ? scene_names() : options.scenes;
  if (options.agreement > 0) return check_agreement(options, scenes);
  std::int64_t wrong = 0;
  if (options.growth || options.depth) {
    const nlohmann::json figures = measure_growth(options.quick, options.depth, &wrong);
    return finish(options, figures, wrong);
  }
  if (options.first_hits) {
    const nlohmann::json figures = measure_first_hits(scenes, options.quick, &wrong);
    return finish(options, figures, wrong);
  }
  Figures figures;
  for (const std::string& name : scenes) run_scene(options, name, figures);
  std::printf("\ngeometric means of ours / peer\n");
  for (const auto& [kind, mean] : geometric_means(figures)) {
    std::printf("  %-16s %.3f\n", kind.c_str(), mean);
  }
  for (const Row& row : figures.rays) wrong += row.wrong;
  for (const Row& row : figures.packets) wrong += row.wrong;
  return finish(options, to_json(figures), wrong);
}

}  // namespace
}  // namespace tessera::render::bench

int main(int argc, char** argv) {
  tessera::render::bench::Options options;
  CLI::App app("Compares rays per second of Tessera's BVHs with Embree.");
  app.add_option("--peer", options.peer, "Structure to compare with")
      ->check(CLI::IsMember({"embree"}));
  app.add_option("--json", options.json, "File for the figures as JSON (default: stdout)")
      ->expected(0, 1)
      ->default_str("-");
  app.add_option("--isa", options.isa, "Tessera's instruction set: avx2 or avx512")
      ->check(CLI::IsMember({"avx2", "avx512"}));
  app.add_option("--quality", options.quality, "Tessera's build quality: fast, default or high")
      ->check(CLI::IsMember({"fast", "default", "high"}));
  app.add_option("--scene", options.scenes, "Scenes to measure (default: all)")
      ->check(CLI::IsMember(tessera::render::bench::scene_names()));
  app.add_option("--kind", options.kinds, "Kinds of rays to measure (default: all)");
  app.add_option("--rounds", options.rounds, "Number of measurements; the best one is reported");
  app.add_option("--side", options.side, "Camera rays per side of the view");
  app.add_option("--agreement", options.agreement,
                 "Compare the hits of this number of rays instead of measuring");
  app.add_option("--brute", options.brute,
                 "With --agreement: maximum rays per scene to also trace by brute force");
  app.add_flag("--references", options.references,
               "With --agreement: also trace with the structures of worker/accelerators");
  app.add_flag("--growth", options.growth, "Measure how the cost of a ray grows with the scene");
  app.add_flag("--depth", options.depth,
               "Measure only how the cost grows with depth complexity, also that of a z-buffer");
  app.add_flag("--first-hits", options.first_hits,
               "Compare orders of camera rays, packets and an item buffer");
  app.add_flag("--quick", options.quick, "Use small scenes, to test the benchmark itself");
  CLI11_PARSE(app, argc, argv);
  return tessera::render::bench::run(options);
}
