#include "worker/gltf/checks/precision_check.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::render {

std::optional<Problem> check_precision(std::span<const PlacedBox> placed, const Vec3d& center) {
  constexpr double kSpacing = 0x1p-23;          // relative spacing of floats
  constexpr double kMaxRelativeSpacing = 0.02;  // maximum spacing relative to an object's size
  std::size_t count = 0;
  std::int32_t worst = 0;
  double error = 0;
  for (const auto& [box, node] : placed) {
    const double size = max_abs(box.high - box.low);
    const double spacing =
        kSpacing * std::max(max_abs(box.low - center), max_abs(box.high - center));
    if (!(size > 0) || !(spacing > kMaxRelativeSpacing * size)) continue;
    ++count;
    if (spacing > error) worst = node;
    error = std::max(error, spacing);
  }
  if (count == 0) return std::nullopt;
  const std::string others =
      count > 1 ? absl::StrCat("; the same holds for ", count - 1, " others") : "";
  return Problem{Problem::Severity::warning, absl::StrCat("nodes[", worst, "]"),
                 absl::StrCat("is too far from the scene centre: position error up to ",
                              absl::StrFormat("%.1g", error), " m (over 2 % of its size)", others,
                              "; split distant objects into separate scenes")};
}

}  // namespace tessera::render
