#include "worker/gltf/animation/selection.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::render {

absl::StatusOr<std::int32_t> choose(const std::vector<std::string>& names,
                                    const std::string& wanted, const std::string& kind) {
  const auto named = std::find(names.begin(), names.end(), wanted);
  if (named != names.end()) return static_cast<std::int32_t>(named - names.begin());
  std::int32_t index = -1;
  if (absl::SimpleAtoi(wanted, &index) && index >= 0 &&
      static_cast<std::size_t>(index) < names.size()) {
    return index;
  }
  constexpr std::size_t kShown = 20;
  std::string known;
  for (std::size_t i = 0; i < names.size() && i < kShown; ++i) {
    absl::StrAppend(&known, i == 0 ? "" : ", ", i, names[i].empty() ? "" : " \"", names[i],
                    names[i].empty() ? "" : "\"");
  }
  return absl::InvalidArgumentError(absl::StrCat(kind, ": \"", wanted,
                                                 "\" not found; the file has ",
                                                 names.empty() ? std::string("none") : known));
}

}  // namespace tessera::render
