#include "worker/guide/photon_trace.h"

#include <algorithm>

#include "worker/guide/photon_chains.h"
#include "worker/guide/photon_store.h"
#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

/// Photons are traced in rounds until there are enough (PhotonStore), or kMaxRounds are done, or
/// more photons make the guide no better. Measured: docs/notes/guiding.md.
constexpr std::int64_t kPhotonsPerRound = 1 << 16;
constexpr int kMaxRounds = 32;
/// The first kIndependentRounds and then each kIndependentEvery-th have independent paths; the
/// others continue useful paths.
constexpr int kIndependentRounds = 2, kIndependentEvery = 4;
/// A frame is not guided if guiding removes less of a sample's relative variance than kMinSaving.
/// After 4, 8 and 16 rounds, no more photons are traced unless it grew by the factor kMinGrowth.
constexpr double kMinSaving = 0.2, kMinGrowth = 1.25;
/// Rounds do not end for either reason before kReached of the cells that are seen have a photon and
/// kCovered of them have kCoveredPhotons, because the saving is random where photons are few.
constexpr double kReached = 0.4, kCovered = 0.1;
constexpr std::uint32_t kCoveredPhotons = 8;
constexpr std::int64_t kPhotonsPerChunk = 1024;
constexpr std::uint64_t kDomain = 0x70686f746f6e7301ULL;
constexpr std::uint64_t kSeenDomain = 0x70686f746f6e7302ULL;
constexpr std::uint64_t kChainDomain = 0x70686f746f6e7303ULL;

std::uint64_t frame_key(const PhotonScene& scene, std::uint64_t domain) {
  return combine(domain, pack(scene.seed, static_cast<std::uint32_t>(scene.frame)));
}

std::vector<Photon> trace_independent(const PhotonTracing& tracing, std::int64_t first,
                                      std::int64_t count) {
  const std::int64_t chunks = (count + kPhotonsPerChunk - 1) / kPhotonsPerChunk;
  const std::uint64_t frame = frame_key(tracing.scene, kDomain);
  return trace_parts(
      chunks, tracing.parallel_for, [&](std::int64_t chunk, std::vector<Photon>* stored) {
        const std::int64_t begin = chunk * kPhotonsPerChunk;
        const std::int64_t end = std::min(begin + kPhotonsPerChunk, count);
        for (std::int64_t i = begin; i < end; ++i) {
          const std::uint64_t key = combine(frame, static_cast<std::uint64_t>(first + i));
          PhotonPath(tracing.scene, PhotonRandom(key), key)
              .trace(tracing.source, tracing.region, stored);
        }
      });
}

/// Adds the photons of round number `round`.
void trace_round(const PhotonTracing& tracing, int round, PhotonStore* store) {
  std::vector<std::uint64_t> paths;
  if (round >= kIndependentRounds && round % kIndependentEvery != 0) paths = store->wanted_paths();
  if (paths.empty()) {
    store->add(trace_independent(tracing, round * kPhotonsPerRound, kPhotonsPerRound));
    return;
  }
  const std::uint64_t key =
      combine(frame_key(tracing.scene, kChainDomain), static_cast<std::uint64_t>(round));
  store->add_of_chains(trace_chains(tracing, *store, paths, key, kPhotonsPerRound));
}

/// Relative variance of a sample of a pixel that the guide removes, an estimate.
double saving(const Guide& guide, std::span<const SurfacePlace> places, std::size_t paths) {
  double sum = 0;
  for (const SurfacePlace& place : places)
    sum += double{guide.saving(place.position, place.normal)};
  return sum / static_cast<double>(paths);
}

/// Saving after a number of rounds below which no more follow. `before`: half as many rounds ago.
/// As long as photons have reached few of the places, they say little about the others.
double least_saving(int rounds, bool is_covered, double before) {
  if (!is_covered) return 0;
  if (rounds <= kIndependentRounds) return kMinSaving / 2;
  return std::max(kMinSaving, kMinGrowth * before);
}

}  // namespace

std::vector<Photon> trace_photons(const PhotonScene& scene, const VisibleRegion& region,
                                  std::int64_t first, std::int64_t count,
                                  const ParallelFor& parallel_for) {
  const PhotonSource source(scene.scene, scene.shading, scene.lights);
  if (source.empty()) return {};
  return trace_independent({scene, source, region, parallel_for}, first, count);
}

std::vector<SurfacePlace> seen_places(const PhotonScene& scene) {
  std::vector<SurfacePlace> places;
  std::uint64_t number = 0;
  for (const Ray& ray : scene.camera_rays) {
    const std::vector<SurfacePlace> seen =
        PhotonPath(scene, PhotonRandom(combine(kSeenDomain, number++)), 0).look(ray);
    places.insert(places.end(), seen.begin(), seen.end());
  }
  return places;
}

std::unique_ptr<const Guide> build_guide(const PhotonScene& scene,
                                         const ParallelFor& parallel_for) {
  const PhotonSource source(scene.scene, scene.shading, scene.lights);
  if (source.empty()) return nullptr;
  const std::vector<SurfacePlace> places = seen_places(scene);
  const VisibleRegion region(places);
  PhotonStore store(region, scene.pixels);
  std::unique_ptr<const Guide> guide;
  double saved = 0;
  for (int rounds = 0; rounds < kMaxRounds && !store.is_enough();) {
    trace_round({scene, source, region, parallel_for}, rounds, &store);
    ++rounds;
    if ((rounds & (rounds - 1)) != 0 && !store.is_enough()) continue;
    guide = Guide::from_photons(store.photons(), parallel_for);
    if (region.is_all()) return guide;
    const double before = saved;
    saved = guide == nullptr ? 0 : saving(*guide, places, scene.camera_rays.size());
    const bool is_covered =
        store.share_of_seen(1) >= kReached && store.share_of_seen(kCoveredPhotons) >= kCovered;
    if (saved < least_saving(rounds, is_covered, before)) break;
  }
  return saved < kMinSaving ? nullptr : std::move(guide);
}

}  // namespace tessera::render
