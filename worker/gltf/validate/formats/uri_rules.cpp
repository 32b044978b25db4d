#include "worker/gltf/validate/formats/uri_rules.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "worker/gltf/file/uri.h"

namespace tessera::render {
namespace {

constexpr std::string_view kScheme = "data:";

/// Whether a data URI names a type with one slash, or none, and every parameter has a value; the
/// last one may be "base64" instead.
bool has_valid_header(std::string_view uri) {
  const std::size_t comma = uri.find(',');
  if (comma == std::string_view::npos) return false;
  std::string_view header = uri.substr(kScheme.size(), comma - kScheme.size());
  const std::string_view type = header.substr(0, header.find(';'));
  if (!type.empty() && std::count(type.begin(), type.end(), '/') != 1) return false;
  header.remove_prefix(type.size());
  while (!header.empty()) {
    if (header == ";base64") return true;
    const std::string_view parameter = header.substr(0, header.find(';', 1));
    if (parameter.find('=') == std::string_view::npos) return false;
    header.remove_prefix(parameter.size());
  }
  return true;
}

}  // namespace

UriForm form_of_uri(std::string_view uri) {
  if (is_data_uri(uri)) return UriForm::invalid;
  const std::size_t colon = uri.find_first_of(":/?#");
  if (colon != std::string_view::npos && uri[colon] == ':') {
    const std::string_view scheme = uri.substr(0, colon);
    const bool valid = !scheme.empty() &&
                       absl::ascii_isalpha(static_cast<unsigned char>(scheme[0])) &&
                       std::all_of(scheme.begin(), scheme.end(), [](char c) {
                         return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '+' ||
                                c == '-' || c == '.';
                       });
    return valid ? UriForm::other : UriForm::invalid;
  }
  const bool plain = !uri.empty() && uri[0] == '/' ? false : uri.find_first_of("?#") == uri.npos;
  return plain ? UriForm::relative : UriForm::other;
}

bool is_valid_data_uri(std::string_view uri) {
  return is_data_uri(uri) && has_valid_header(uri) && decode_data_uri(uri).ok();
}

std::string media_type_of(std::string_view uri) {
  uri.remove_prefix(std::min(kScheme.size(), uri.size()));
  const std::string type =
      absl::AsciiStrToLower(std::string(uri.substr(0, uri.find_first_of(";,"))));
  return type.empty() ? "text/plain" : type;
}

}  // namespace tessera::render
