#include "worker/shading/surface/surface_procedural.h"

#include <algorithm>
#include <cmath>

#include "worker/geometry/frame.h"
#include "worker/geometry/shapes/shape_surface.h"
#include "worker/shading/texture/procedural_texture.h"

namespace tessera::render {

namespace {

/// Texture coordinates of a procedural texture over the plane of a triangle: linear, so given by a
/// point and two slopes. On a shape, the triangle is tangent to it and a 1024th of its size.
class Coordinates {
 public:
  Coordinates(const ShadingScene& scene, const ShadingPoint& p, const TextureRef& ref,
              const ProceduralTexture& f)
      : scene_(scene), point_(p), ref_(ref), f_(f) {
    const Vec3d a = corner(0);
    to_second_ = corner(1) - a;
    to_third_ = corner(2) - a;
    at_ = a + to_second_ * static_cast<double>(p.b1) + to_third_ * static_cast<double>(p.b2);
    compute_edges();
  }

  const Vec3d& at() const { return at_; }

  /// Change of the coordinates per metre along `along`, a world vector in the triangle's plane.
  Vec3d slope(const Vec3d& along) const {
    const Vec3d across = cross(edge1_, edge2_);
    const double area = dot(across, across);
    if (!(area > 0)) return {};
    const double b1 = dot(cross(along, edge2_), across) / area;
    const double b2 = dot(cross(edge1_, along), across) / area;
    return to_second_ * b1 + to_third_ * b2;
  }

  /// Features per metre along `along`.
  double features(const Vec3d& along) const { return length(slope(along) * Vec3d(f_.scale)); }

 private:
  Vec3d corner(std::size_t k) const {
    if (f_.space == ProceduralTexture::Space::uv) {
      if (point_.shape != nullptr) {
        const Vec3f on(position(k));
        const Vec2f t = transformed_uv(ref_, shape_uv(*point_.shape, point_.face, on));
        return {static_cast<double>(t.x), static_cast<double>(t.y), 0};
      }
      const std::uint32_t v = point_.vertices[k];
      const Vec2f* uv = point_.primitive->uv[ref_.uv_set == 1 ? 1 : 0];
      if (uv == nullptr) return {};
      const Vec2f t = transformed_uv(ref_, uv[v]);
      return {static_cast<double>(t.x), static_cast<double>(t.y), 0};
    }
    const Vec3d object = position(k);
    if (f_.space == ProceduralTexture::Space::object) return object;
    const Affine3d& world = point_.instance->source->object_to_world;
    return transform_point(world, object) + scene_.textures.center();
  }

  /// A vertex in object space.
  Vec3d position(std::size_t k) const {
    const Shape* shape = point_.shape;
    if (shape == nullptr) return Vec3d(point_.primitive->positions[point_.vertices[k]]);
    const Vec3d at(point_.local);
    if (k == 0) return at;
    const Vec3f normal(normalize(shape_normal(*shape, point_.face, at)));
    const Frame plane = Frame::from_normal(normal);
    // On a plane, the rounding of coordinates to float grows with the distance.
    const float size = shape->bounded() ? max_abs(shape->bounds.hi - shape->bounds.lo)
                                        : std::max(1.0f, max_abs(point_.local));
    return at + Vec3d((k == 1 ? plane.s : plane.t) * (size * 0x1p-10f));
  }

  void compute_edges() {
    const Affine3d& world = point_.instance->source->object_to_world;
    edge1_ = transform_vector(world, position(1) - position(0));
    edge2_ = transform_vector(world, position(2) - position(0));
  }

  const ShadingScene& scene_;
  const ShadingPoint& point_;
  const TextureRef& ref_;
  const ProceduralTexture& f_;
  Vec3d at_, to_second_, to_third_;  // in texture space
  Vec3d edge1_, edge2_;              // in world space
};

/// The footprint in features, along the direction in which they are densest.
float footprint_in_features(const ShadingPoint& p, const Coordinates& coordinates) {
  if (!(p.footprint > 0)) return 0;
  const Frame plane = Frame::from_normal(p.geometric_normal);
  const double s = coordinates.features(Vec3d(plane.s)), t = coordinates.features(Vec3d(plane.t));
  return p.footprint * static_cast<float>(s > t ? s : t);
}

}  // namespace

Vec4f procedural_color_at(const ShadingScene& scene, const ShadingPoint& p, const TextureRef& ref,
                          const ProceduralTexture& f) {
  const Coordinates coordinates(scene, p, ref, f);
  return procedural_color(f, coordinates.at(), footprint_in_features(p, coordinates));
}

Vec3f procedural_bumped(const ShadingScene& scene, const ShadingPoint& p, const TextureRef& ref,
                        const ProceduralTexture& f, float scale, const Vec3f& normal) {
  const Coordinates coordinates(scene, p, ref, f);
  const Frame plane = Frame::from_normal(p.geometric_normal);
  const float footprint = footprint_in_features(p, coordinates);
  // A 64th of the finest feature, but not finer than the footprint: the error of central
  // differences is then at most (2 pi / 64)^2 / 6 = 0.2 % of the slope.
  double finest = 1;
  for (std::int32_t i = 1; i < f.octaves; ++i) finest *= static_cast<double>(f.lacunarity);
  const auto slope = [&](const Vec3f& along) {
    const double features = coordinates.features(Vec3d(along));
    if (!(features > 0)) return 0.0f;
    const double step = (1.0 / 64 / finest + 0.25 * static_cast<double>(footprint)) / features;
    const Vec3d ahead = coordinates.slope(Vec3d(along)) * step;
    const float high = procedural_color(f, coordinates.at() + ahead, footprint).x;
    const float low = procedural_color(f, coordinates.at() - ahead, footprint).x;
    return (high - low) * f.bump_height * scale / static_cast<float>(2 * step);
  };
  const Vec3f tilt = plane.s * slope(plane.s) + plane.t * slope(plane.t);
  // Bumps rise towards the front, whichever side the normal is on.
  const Vec3f tilted = normalize(normal - tilt);
  return tilted == Vec3f{} || !is_finite(tilted) ? normal : tilted;
}

}  // namespace tessera::render
