#include "client/event_name.h"

#include <algorithm>

#include "absl/strings/ascii.h"

namespace tessera::client {

std::string event_name(v1::Event::Kind kind) {
  std::string name = absl::AsciiStrToLower(v1::Event::Kind_Name(kind));
  name.erase(0, std::min(name.size(), sizeof "kind_" - 1));
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

}  // namespace tessera::client
