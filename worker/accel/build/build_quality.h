#pragma once

#include <array>
#include <string_view>

namespace tessera::render {

/// How much work goes into a tree. Hits do not depend on it.
enum class BuildQuality {
  fast,    // binned SAH
  normal,  // and spatial splits: what renders use
  high,    // and subtrees moved to better places
};

inline constexpr std::array kBuildQualities = {BuildQuality::fast, BuildQuality::normal,
                                               BuildQuality::high};

constexpr std::string_view quality_name(BuildQuality quality) {
  return quality == BuildQuality::fast     ? "fast"
         : quality == BuildQuality::normal ? "default"
                                           : "high";
}

}  // namespace tessera::render
