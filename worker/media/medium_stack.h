#pragma once

#include <array>
#include <cstdint>

#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Something closed that a ray can be in: an instance, or a CSG solid, with the material of the
/// surface the ray came through, which says what fills it.
struct Body {
  std::uint32_t id = 0;  // InstanceView::body
  const MaterialView* material = nullptr;
  const InstanceView* instance = nullptr;
};

inline Body body_of(const ShadingPoint& point) {
  return {point.instance->body, point.material, point.instance->still};
}

/// The bodies that a ray is in, in the order it entered them. Where several overlap, the one of the
/// highest rank is there, among equals the one entered last.
/// Source: C. Schmidt and B. Budge, "Simple nested dielectrics in ray traced images", 2002.
class MediumStack {
 public:
  /// Beyond so many at once, the ones entered last are not seen.
  static constexpr std::uint32_t kMost = 8;

  void enter(const Body& body) {
    if (count_ < kMost) bodies_[count_++] = body;
  }

  /// Takes out the body entered last of those with the id, rather one of the same material; does
  /// nothing if there is none.
  void leave(const Body& body) {
    const std::uint32_t index = find(body);
    if (index == count_) return;
    --count_;
    for (std::uint32_t i = index; i < count_; ++i) bodies_[i] = bodies_[i + 1];
  }

  void cross(const Body& body, bool inwards) { inwards ? enter(body) : leave(body); }

  /// What is there; null: none of them.
  const Body* top() const { return top_of(count_); }

  /// What is there beside `body`, on the other side of its surface.
  const Body* beside(const Body& body) const { return top_of(find(body)); }

  /// Whether the surface of `body` does not count, as something of higher rank is on both sides.
  bool hides(const Body& body) const {
    const Body* other = beside(body);
    return other != nullptr && other->material->rank > body.material->rank;
  }

 private:
  /// Index of the entry that leave() takes, or count_.
  std::uint32_t find(const Body& body) const {
    std::uint32_t found = count_;
    for (std::uint32_t i = 0; i < count_; ++i) {
      if (bodies_[i].id != body.id) continue;
      const bool better = found == count_ || bodies_[i].material == body.material ||
                          bodies_[found].material != body.material;
      if (better) found = i;
    }
    return found;
  }

  const Body* top_of(std::uint32_t without) const {
    const Body* best = nullptr;
    for (std::uint32_t i = 0; i < count_; ++i) {
      if (i == without) continue;
      if (best == nullptr || bodies_[i].material->rank >= best->material->rank) best = &bodies_[i];
    }
    return best;
  }

  std::uint32_t count_ = 0;
  std::array<Body, kMost> bodies_;
};

}  // namespace tessera::render
