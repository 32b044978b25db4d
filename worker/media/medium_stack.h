#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

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

/// Index of the entry that ends where a path leaves `body`: the last one with its id, preferably of
/// the same material. Several instances may be the surfaces of one solid, such as the outside and
/// the cavity of a hollow ball: without such an entry it is the last one of the same material.
/// entered.size() if there is none.
inline std::size_t entry_left(std::span<const Body> entered, const Body& body) {
  std::size_t best = entered.size();
  int best_match = 1;
  for (std::size_t i = 0; i < entered.size(); ++i) {
    const int match =
        (entered[i].id == body.id ? 2 : 0) + (entered[i].material == body.material ? 1 : 0);
    if (match < best_match) continue;
    best = i;
    best_match = match;
  }
  return best;
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

  /// Crosses a surface of `body`; a body that was not entered is not left (entry_left()).
  void cross(const Body& body, bool inwards) {
    if (inwards) return enter(body);
    const std::size_t index = entry_left({bodies_.data(), count_}, body);
    if (index == count_) return;
    --count_;
    for (std::size_t i = index; i < count_; ++i) bodies_[i] = bodies_[i + 1];
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
  /// Index of the last entry with the id of `body`, preferably of the same material; or count_.
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
