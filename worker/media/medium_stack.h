#pragma once

#include <array>
#include <cstdint>

#include "worker/shading/surface/shading_scene.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// A closed body: an instance or a CSG solid, with the material of the surface through which the
/// ray entered it.
struct Body {
  std::uint32_t id = 0;  // InstanceView::body
  const MaterialView* material = nullptr;
  const InstanceView* instance = nullptr;
};

inline Body body_of(const ShadingPoint& point) {
  return {point.instance->body, point.material, point.instance->still};
}

/// Bodies that contain the current point of a path, in order of entry. Where several overlap, the
/// one of highest rank is effective, among equals the last entered. Source: C. Schmidt and B.
/// Budge, "Simple nested dielectrics in ray traced images", 2002.
class MediumStack {
 public:
  /// Maximum nesting depth; deeper bodies are ignored.
  static constexpr std::uint32_t kMaxDepth = 8;

  void enter(const Body& body) {
    if (count_ < kMaxDepth) bodies_[count_++] = body;
  }

  /// Removes the last entered body with that id, preferably one of the same material; does nothing
  /// if there is none.
  void leave(const Body& body) { remove(find(body)); }

  /// Crosses a surface of `body`. If it leads out of a body that was not entered, several instances
  /// may be the surfaces of one solid, such as the outside and the cavity of a hollow ball: then
  /// the last entered body of the same material is left, if any.
  void cross(const Body& body, bool inwards) {
    if (inwards) return enter(body);
    std::uint32_t index = find(body);
    for (std::uint32_t i = count_; index == count_ && i-- > 0;) {
      if (bodies_[i].material == body.material) index = i;
    }
    remove(index);
  }

  /// Highest-ranked body, or null.
  const Body* top() const { return top_without(count_); }

  /// Highest-ranked body except `body`: the one on the other side of its surface.
  const Body* top_except(const Body& body) const { return top_without(find(body)); }

  /// Returns whether the surface of `body` is invisible because a body of higher rank surrounds it.
  bool hides(const Body& body) const {
    const Body* other = top_except(body);
    return other != nullptr && other->material->rank > body.material->rank;
  }

 private:
  void remove(std::uint32_t index) {
    if (index == count_) return;
    --count_;
    for (std::uint32_t i = index; i < count_; ++i) bodies_[i] = bodies_[i + 1];
  }

  /// Index of the entry that leave() removes, or count_.
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

  const Body* top_without(std::uint32_t without) const {
    const Body* best = nullptr;
    for (std::uint32_t i = 0; i < count_; ++i) {
      if (i == without) continue;
      if (best == nullptr || bodies_[i].material->rank >= best->material->rank) best = &bodies_[i];
    }
    return best;
  }

  std::uint32_t count_ = 0;
  std::array<Body, kMaxDepth> bodies_;
};

}  // namespace tessera::render
