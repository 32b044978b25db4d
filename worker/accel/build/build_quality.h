#pragma once

#include <array>
#include <string_view>

namespace tessera::render {

/// Effort spent on building a BVH. Hits do not depend on it.
enum class BuildQuality {
  fast,    // binned SAH
  normal,  // with spatial splits; used by renders
  high,    // with spatial splits and reinsertion of subtrees
};

inline constexpr std::array kBuildQualities = {BuildQuality::fast, BuildQuality::normal,
                                               BuildQuality::high};

constexpr std::string_view quality_name(BuildQuality quality) {
  return quality == BuildQuality::fast     ? "fast"
         : quality == BuildQuality::normal ? "default"
                                           : "high";
}

}  // namespace tessera::render
