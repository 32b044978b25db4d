#include "worker/guide/photon_trace.h"

#include <algorithm>
#include <utility>

#include "worker/geometry/surface_point.h"
#include "worker/guide/photon_source.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {
namespace {

/// Photons are emitted in rounds until half of the cells that are seen have kEnoughInCell photons,
/// or there are kMaxPhotonCount, or kMaxRounds are done, or more photons make the guide no better.
/// Each cell takes at most kMaxInCell, so that bright places leave room for others. Measured:
/// docs/notes/guiding.md.
constexpr std::int64_t kPhotonsPerRound = 1 << 16;
constexpr std::uint32_t kEnoughInCell = 64, kMaxInCell = 512;
constexpr std::size_t kMaxPhotonCount = 1 << 17;
constexpr int kMaxRounds = 16;
/// A frame is not guided if guiding removes less of a sample's relative variance than kMinSaving.
/// After 1, 2, 4 and 8 rounds, no more photons are emitted unless this grew by the factor
/// kMinGrowth.
constexpr double kMinSaving = 0.1, kMinGrowth = 1.25;
constexpr std::int64_t kPhotonsPerChunk = 1024;
constexpr int kMaxPassed = 64;          // surfaces that a photon passes without scattering
constexpr std::int32_t kMaxDepth = 32;  // scattering events of a photon
constexpr std::uint64_t kDomain = 0x70686f746f6e7301ULL;
constexpr std::uint64_t kSeenDomain = 0x70686f746f6e7302ULL;
constexpr std::size_t kSeenPlaces = 2;  // of each path from the camera

class PhotonPath {
 public:
  PhotonPath(const PhotonScene& scene, std::uint64_t key, std::vector<Photon>* stored)
      : scene_(scene), random_(key), stored_(stored) {}

  /// Follows a photon and stores it where it arrives in `region`.
  void trace(const PhotonSource& source, const VisibleRegion& region) {
    region_ = &region;
    const std::optional<PhotonSource::Emission> emission = source.emit(&random_);
    if (!emission) return;
    ray_ = emission->ray;
    flux_ = emission->flux;
    is_found_ = emission->is_found;
    is_point_ = emission->is_point;
    if (scene_.moves) ray_.time = random_.next();
    walk();
  }

  /// Follows a path from the camera and returns where it meets surfaces that are not specular.
  std::vector<SurfacePlace> look(const Ray& camera_ray) {
    ray_ = camera_ray;
    flux_ = {1, 1, 1};
    walk();
    return std::move(seen_);
  }

 private:
  void walk() {
    const std::int32_t most = std::min(scene_.max_depth, kMaxDepth);
    while (depth_ < most && passed_ <= kMaxPassed && step()) {
    }
  }

  /// Handles the next surface. Returns false if the path ends.
  bool step() {
    Hit hit;
    if (!scene_.accel.closest_hit(ray_, hit)) return false;
    const ShadingPoint point = surface_at(scene_.shading, hit, ray_.direction, ray_.time, memory_);
    const SurfacePoint position = position_of(point);
    const Vec4f base = base_color_at(scene_.shading, point);
    if (is_unseen(point)) return pass(hit, position);
    const Bsdf bsdf = bsdf_at(scene_.shading, point, base, -ray_.direction);
    if (goes_straight(bsdf)) return pass(hit, position);
    if (region_ == nullptr && has_smooth_density(bsdf)) {
      seen_.push_back({position.position, bsdf.frame.geometric_normal});
      if (seen_.size() == kSeenPlaces) return false;
    }
    if (region_ != nullptr && has_smooth_density(bsdf) &&
        region_->contains({position.position, bsdf.frame.geometric_normal})) {
      stored_->push_back({position.position, -ray_.direction, bsdf.frame.geometric_normal,
                          luminance(flux_), is_found_ ? 0.0f : 1.0f});
    }
    return scatter(bsdf, hit.id, position);
  }

  bool is_unseen(const ShadingPoint& point) {
    const MaterialView& material = *point.material;
    if (material.source->unlit) return true;
    if ((material.traits & kTraitCrossed) != 0 && material.rank == kBoundaryRank) return true;
    const float coverage = coverage_at(scene_.shading, point);
    return coverage < 1 && !(random_.next() < coverage);
  }

  /// Light sampling finds light that goes straight through a thin surface.
  bool goes_straight(const Bsdf& bsdf) {
    const Vec3f share = straight_transmittance(bsdf);
    const float straight = luminance(share);
    if (!(straight > 0)) return false;
    const float probability = straight / (straight + scattered_albedo(bsdf));
    if (!(random_.next() < probability)) {
      flux_ = flux_ / (1 - probability);
      return false;
    }
    flux_ *= share / probability;
    return true;
  }

  bool pass(const Hit& hit, const SurfacePoint& position) {
    ++passed_;
    follow(position, hit.id, ray_.direction);
    return true;
  }

  bool scatter(const Bsdf& bsdf, const TriangleId& id, const SurfacePoint& position) {
    BsdfSample next;
    const float lobe = random_.next();
    const Vec2f u = random_.next_2d();
    if (!sample_bsdf(bsdf, lobe, u, &next)) return false;
    // No path has this light: it can neither hit the light nor sample it through a specular
    // surface.
    if (is_point_ && next.delta) return false;
    is_point_ = false;
    const Vec3f after = flux_ * next.weight;
    const float survival = luminance(after) / luminance(flux_);
    if (!(survival > 0)) return false;
    flux_ = after;
    if (survival < 1) {
      if (!(random_.next() < survival)) return false;
      flux_ = flux_ / survival;
    }
    ++depth_;
    is_found_ = false;
    follow(position, id, next.wi);
    return is_finite(flux_);
  }

  void follow(const SurfacePoint& position, const TriangleId& id, const Vec3f& direction) {
    const float time = ray_.time;
    ray_ = spawn_ray(position, id, direction);
    ray_.time = time;
  }

  const PhotonScene& scene_;
  PhotonRandom random_;
  std::vector<Photon>* stored_;
  const VisibleRegion* region_ = nullptr;  // of a photon; null for a path from the camera
  std::vector<SurfacePlace> seen_;         // by a path from the camera
  MovedSurface memory_;
  Ray ray_;
  Vec3f flux_;
  bool is_found_ = true;   // by light sampling, where it arrives next
  bool is_point_ = false;  // comes straight from a light that no ray can hit
  std::int32_t depth_ = 0;
  int passed_ = 0;
};

std::vector<Photon> trace_from(const PhotonScene& scene, const PhotonSource& source,
                               const VisibleRegion& region, std::int64_t first, std::int64_t count,
                               const ParallelFor& parallel_for) {
  const std::int64_t chunks = (count + kPhotonsPerChunk - 1) / kPhotonsPerChunk;
  std::vector<std::vector<Photon>> stored(static_cast<std::size_t>(chunks));
  const std::uint64_t frame =
      combine(kDomain, pack(scene.seed, static_cast<std::uint32_t>(scene.frame)));
  parallel_for(chunks, [&](std::int64_t chunk) {
    const std::int64_t begin = chunk * kPhotonsPerChunk;
    const std::int64_t end = std::min(begin + kPhotonsPerChunk, count);
    for (std::int64_t i = begin; i < end; ++i) {
      PhotonPath path(scene, combine(frame, static_cast<std::uint64_t>(first + i)),
                      &stored[static_cast<std::size_t>(chunk)]);
      path.trace(source, region);
    }
  });
  std::vector<Photon> all;
  for (const std::vector<Photon>& part : stored) all.insert(all.end(), part.begin(), part.end());
  return all;
}

/// Photons of all rounds, at most kMaxInCell in a cell of the region.
class PhotonStore {
 public:
  explicit PhotonStore(const VisibleRegion& region)
      : region_(region),
        counts_(VisibleRegion::kCells),
        found_(VisibleRegion::kCells),
        guided_(VisibleRegion::kCells) {}

  void add(const std::vector<Photon>& photons) {
    for (const Photon& photon : photons) {
      const bool is_found = photon.share == 0;
      if (!region_.is_all()) {
        const std::size_t cell = region_.cell({photon.position, photon.normal});
        (is_found ? found_ : guided_)[cell] += double{photon.flux};
        if (!is_found && counts_[cell]++ >= kMaxInCell) continue;
      }
      if (!is_found) photons_.push_back(photon);
    }
  }

  /// Share of the cells that are seen to which at least `least` photons came.
  double share_of_seen(std::uint32_t least) const {
    const auto seen = region_.seen_cells();
    const auto reached = std::count_if(seen.begin(), seen.end(),
                                       [&](std::uint32_t cell) { return counts_[cell] >= least; });
    return seen.empty() ? 1 : static_cast<double>(reached) / static_cast<double>(seen.size());
  }

  bool is_enough() const {
    if (photons_.size() >= kMaxPhotonCount) return true;
    return !photons_.empty() && share_of_seen(kEnoughInCell) >= 0.5;
  }

  /// The photons that may guide, with their shares.
  std::vector<Photon> photons() const {
    std::vector<Photon> all = photons_;
    if (region_.is_all()) return all;
    for (Photon& photon : all) {
      const std::size_t cell = region_.cell({photon.position, photon.normal});
      photon.share = static_cast<float>(guided_[cell] / (guided_[cell] + found_[cell]));
    }
    return all;
  }

 private:
  const VisibleRegion& region_;
  std::vector<std::uint32_t> counts_;   // of photons that may guide, by cell of the region
  std::vector<double> found_, guided_;  // flux that light sampling finds, and other flux, by cell
  std::vector<Photon> photons_;
};

/// Relative variance of a sample of a pixel that the guide removes, an estimate.
double saving(const Guide& guide, std::span<const SurfacePlace> places, std::size_t paths) {
  double sum = 0;
  for (const SurfacePlace& place : places)
    sum += double{guide.saving(place.position, place.normal)};
  return sum / static_cast<double>(paths);
}

}  // namespace

std::vector<Photon> trace_photons(const PhotonScene& scene, const VisibleRegion& region,
                                  std::int64_t first, std::int64_t count,
                                  const ParallelFor& parallel_for) {
  const PhotonSource source(scene.scene, scene.shading, scene.lights);
  if (source.empty()) return {};
  return trace_from(scene, source, region, first, count, parallel_for);
}

std::vector<SurfacePlace> seen_places(const PhotonScene& scene) {
  std::vector<SurfacePlace> places;
  std::uint64_t number = 0;
  for (const Ray& ray : scene.camera_rays) {
    const std::vector<SurfacePlace> seen =
        PhotonPath(scene, combine(kSeenDomain, number++), nullptr).look(ray);
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
  PhotonStore store(region);
  std::unique_ptr<const Guide> guide;
  double saved = 0;
  for (int rounds = 0; rounds < kMaxRounds && !store.is_enough();) {
    store.add(trace_from(scene, source, region, rounds * kPhotonsPerRound, kPhotonsPerRound,
                         parallel_for));
    ++rounds;
    if ((rounds & (rounds - 1)) != 0 && !store.is_enough()) continue;
    guide = Guide::from_photons(store.photons(), parallel_for);
    if (region.is_all()) return guide;
    const double before = saved;
    saved = guide == nullptr ? 0 : saving(*guide, places, scene.camera_rays.size());
    if (store.share_of_seen(1) < 0.5) continue;
    const double least = rounds == 1 ? kMinSaving / 2 : std::max(kMinSaving, kMinGrowth * before);
    if (saved < least) break;
  }
  return saved < kMinSaving ? nullptr : std::move(guide);
}

}  // namespace tessera::render
