#include "worker/gltf/build/precision_check.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::render {

std::optional<Problem> check_precision(std::span<const PlacedBox> placed, const Vec3d& center) {
  constexpr double kSpacing = 0x1p-23;  // of neighbouring floats, of their value
  constexpr double kShare = 0.02;       // of a thing's size, which may be in doubt
  std::size_t count = 0;
  std::int32_t worst = 0;
  double doubt = 0;
  for (const auto& [box, node] : placed) {
    const double size = max_abs(box.high - box.low);
    const double spacing =
        kSpacing * std::max(max_abs(box.low - center), max_abs(box.high - center));
    if (!(size > 0) || !(spacing > kShare * size)) continue;
    ++count;
    if (spacing > doubt) worst = node;
    doubt = std::max(doubt, spacing);
  }
  if (count == 0) return std::nullopt;
  const std::string others = count > 1 ? absl::StrCat(", as with ", count - 1, " others") : "";
  return Problem{
      Problem::Severity::warning, absl::StrCat("nodes[", worst, "]"),
      absl::StrCat("is so far from the middle of the scene that its place is good to ",
                   absl::StrFormat("%.1g", doubt), " m only, a fiftieth of its size or more",
                   others, ": render what lies so far apart as scenes of their own")};
}

}  // namespace tessera::render
