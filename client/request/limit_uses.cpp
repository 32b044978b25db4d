#include "client/request/limit_uses.h"

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::client {

absl::StatusOr<v1::LimitUses> parse_limit_uses(const std::vector<std::string>& texts) {
  constexpr std::int32_t kMaxUnits = 1000;
  v1::LimitUses uses;
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    std::int32_t units = 1;
    const bool is_number =
        equals == std::string::npos || absl::SimpleAtoi(text.substr(equals + 1), &units);
    if (!is_number || units < 1 || units > kMaxUnits || equals == 0) {
      return absl::InvalidArgumentError(
          absl::StrCat("--limit \"", text, "\" is not NAME or NAME=AMOUNT with 1 to ", kMaxUnits));
    }
    v1::LimitUse* use = uses.add_limits();
    use->set_limit(text.substr(0, equals));
    use->set_unit_count(units);
  }
  return uses;
}

}  // namespace tessera::client
