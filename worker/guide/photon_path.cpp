#include "worker/guide/photon_path.h"

#include <algorithm>
#include <utility>

#include "worker/geometry/surface_point.h"
#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

constexpr int kMaxPassed = 64;          // surfaces that a photon passes without scattering
constexpr std::int32_t kMaxDepth = 32;  // scattering events of a photon
constexpr std::size_t kSeenPlaces = 2;  // of each path from the camera

}  // namespace

std::vector<Photon> trace_parts(
    std::int64_t parts, const ParallelFor& parallel_for,
    const std::function<void(std::int64_t, std::vector<Photon>*)>& trace) {
  std::vector<std::vector<Photon>> photons(static_cast<std::size_t>(parts));
  parallel_for(parts, [&](std::int64_t i) { trace(i, &photons[static_cast<std::size_t>(i)]); });
  std::vector<Photon> all;
  for (const std::vector<Photon>& part : photons) all.insert(all.end(), part.begin(), part.end());
  return all;
}

void PhotonPath::trace(const PhotonSource& source, const VisibleRegion& region,
                       std::vector<Photon>* stored) {
  region_ = &region;
  stored_ = stored;
  const std::optional<PhotonSource::Emission> emission = source.emit(&random_);
  if (!emission) return;
  ray_ = emission->ray;
  flux_ = emission->flux;
  is_found_ = emission->is_found;
  is_point_ = emission->is_point;
  way_ = emission->light;
  if (scene_.moves) ray_.time = random_.next();
  walk();
}

std::vector<SurfacePlace> PhotonPath::look(const Ray& camera_ray) {
  ray_ = camera_ray;
  flux_ = {1, 1, 1};
  walk();
  return std::move(seen_);
}

void PhotonPath::walk() {
  const std::int32_t most = std::min(scene_.max_depth, kMaxDepth);
  while (depth_ < most && passed_ <= kMaxPassed && step()) {
  }
}

/// Handles the next surface. Returns false if the path ends.
bool PhotonPath::step() {
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
                        luminance(flux_), is_found_ ? 0.0f : 1.0f, depth_ == 0 ? 0 : way_, key_});
  }
  return scatter(bsdf, hit.id, position);
}

bool PhotonPath::is_unseen(const ShadingPoint& point) {
  const MaterialView& material = *point.material;
  if (material.source->unlit) return true;
  if ((material.traits & kTraitCrossed) != 0 && material.rank == kBoundaryRank) return true;
  const float coverage = coverage_at(scene_.shading, point);
  return coverage < 1 && !(random_.next() < coverage);
}

/// Light sampling finds light that goes straight through a thin surface.
bool PhotonPath::goes_straight(const Bsdf& bsdf) {
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

bool PhotonPath::pass(const Hit& hit, const SurfacePoint& position) {
  ++passed_;
  follow(position, hit.id, ray_.direction);
  return true;
}

bool PhotonPath::scatter(const Bsdf& bsdf, const TriangleId& id, const SurfacePoint& position) {
  BsdfSample next;
  const float lobe = random_.next();
  const Vec2f u = random_.next_2d();
  if (!sample_bsdf(bsdf, lobe, u, &next)) return false;
  // No path has this light: it can neither hit the light nor sample it through a specular
  // surface.
  if (is_point_ && next.delta) return false;
  is_point_ = false;
  if (way_ != 0) {
    const std::uint64_t surface = combine(pack(id.instance, id.primitive), next.transmitted);
    way_ = next.delta ? combine(way_, surface) : 0;
  }
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

void PhotonPath::follow(const SurfacePoint& position, const TriangleId& id,
                        const Vec3f& direction) {
  const float time = ray_.time;
  ray_ = spawn_ray(position, id, direction);
  ray_.time = time;
}

}  // namespace tessera::render
