#pragma once

#include <memory>
#include <optional>

#include "worker/light/emitters/shape_light.h"
#include "worker/light/tree/light_tree.h"
#include "worker/shading/surface/shading_scene.h"

namespace tessera::render {

/// The emissive medium inside a body as a light. Directions towards it are those of a ShapeLight
/// that encloses the body, its hull: the body's own shape if it has one, otherwise the box of its
/// mesh; the box of the whole motion if it moves during the exposure.
class VolumeLight {
 public:
  /// The medium of `material` inside `instance`; nullopt if that has no volume. Both arguments and
  /// `scene` must outlive it.
  static std::optional<VolumeLight> make(const Scene& scene, const InstanceView& instance,
                                         const MaterialView& material);

  /// Bounds for the light tree; the strength is the mean intensity over all directions.
  LightBounds bounds() const;

  const ShapeLight& hull() const { return *hull_; }
  const MediumView& medium() const { return material_->medium; }
  const MaterialView& material() const { return *material_; }
  const InstanceView& instance() const { return *instance_; }

 private:
  /// What a ShapeLight refers to.
  struct Placed {
    Shape shape;
    Affine3d object_to_world, world_to_object;
  };

  VolumeLight(const InstanceView& instance, const MaterialView& material, const Shape& shape,
              const Affine3d& object_to_world, const Affine3d& world_to_object);

  const InstanceView* instance_;
  const MaterialView* material_;
  std::unique_ptr<Placed> placed_;  // at a fixed address
  std::unique_ptr<ShapeLight> hull_;
};

}  // namespace tessera::render
