#include "worker/gltf/file/uri.h"

#include <algorithm>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace tessera::render {

namespace {

constexpr std::string_view kDataScheme = "data:";

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> percent_decode(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out.push_back(text[i]);
      continue;
    }
    if (i + 2 >= text.size()) return std::nullopt;
    const int high = hex_digit(text[i + 1]), low = hex_digit(text[i + 2]);
    if (high < 0 || low < 0) return std::nullopt;
    out.push_back(static_cast<char>(high * 16 + low));
    i += 2;
  }
  return out;
}

std::vector<std::byte> as_bytes(std::string_view text) {
  const auto* const begin = reinterpret_cast<const std::byte*>(text.data());
  return {begin, begin + text.size()};
}

/// Accepts both base64 alphabets and any padding, but no white space, which absl would skip.
absl::StatusOr<std::vector<std::byte>> decode_base64(std::string_view text) {
  while (!text.empty() && text.back() == '=') text.remove_suffix(1);
  const bool web_safe = text.find_first_of("-_") != std::string_view::npos;
  const bool is_base64 = std::all_of(text.begin(), text.end(), [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
           std::string_view("+/-_").find(c) != std::string_view::npos;
  });
  const absl::string_view encoded(text.data(), text.size());
  std::string out;
  if (is_base64 && text.size() % 4 == 1) {
    return absl::InvalidArgumentError("the data URI's base64 is truncated");
  }
  if (!is_base64 || !(web_safe ? absl::WebSafeBase64Unescape(encoded, &out)
                               : absl::Base64Unescape(encoded, &out))) {
    return absl::InvalidArgumentError("the data URI is not base64");
  }
  return as_bytes(out);
}

bool has_scheme(std::string_view uri) {
  const std::size_t colon = uri.find(':');
  return colon != std::string_view::npos && uri.substr(0, colon).find('/') == std::string::npos;
}

/// Returns whether `text` is well-formed UTF-8, so that messages can contain it.
bool is_utf8(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size()) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const std::size_t length = lead < 0x80   ? 1
                               : lead < 0xC2 ? 0
                               : lead < 0xE0 ? 2
                               : lead < 0xF0 ? 3
                               : lead < 0xF5 ? 4
                                             : 0;
    if (length == 0 || i + length > text.size()) return false;
    for (std::size_t k = 1; k < length; ++k) {
      if ((static_cast<unsigned char>(text[i + k]) & 0xC0) != 0x80) return false;
    }
    const auto second = length > 1 ? static_cast<unsigned char>(text[i + 1]) : 0x80u;
    const bool too_long = (lead == 0xE0 && second < 0xA0) || (lead == 0xF0 && second < 0x90);
    const bool too_far = (lead == 0xED && second > 0x9F) || (lead == 0xF4 && second > 0x8F);
    if (too_long || too_far) return false;
    i += length;
  }
  return true;
}

/// Returns whether a segment of `path` is "..".
bool has_parent_segment(std::string_view path) {
  std::size_t begin = 0;
  while (begin <= path.size()) {
    std::size_t end = path.find('/', begin);
    if (end == std::string_view::npos) end = path.size();
    if (path.substr(begin, end - begin) == "..") return true;
    begin = end + 1;
  }
  return false;
}

}  // namespace

bool is_data_uri(std::string_view uri) {
  return uri.substr(0, kDataScheme.size()) == kDataScheme;
}

absl::StatusOr<std::vector<std::byte>> decode_data_uri(std::string_view uri) {
  const std::size_t comma = uri.find(',');
  if (!is_data_uri(uri) || comma == std::string_view::npos) {
    return absl::InvalidArgumentError("the data URI has no comma");
  }
  constexpr std::string_view kBase64 = ";base64";
  const std::string_view head = uri.substr(0, comma);
  const std::string_view body = uri.substr(comma + 1);
  if (head.size() >= kBase64.size() && head.substr(head.size() - kBase64.size()) == kBase64) {
    return decode_base64(body);
  }
  const auto text = percent_decode(body);
  if (!text) return absl::InvalidArgumentError("the data URI has a bad percent escape");
  return as_bytes(*text);
}

absl::StatusOr<std::string> relative_path(std::string_view uri) {
  std::string shown(uri.substr(0, 200));
  while (shown.size() == 200 && !shown.empty() && (shown.back() & 0x80) != 0) shown.pop_back();
  if (uri.empty()) return absl::InvalidArgumentError("the URI is empty");
  if (has_scheme(uri)) {
    return absl::InvalidArgumentError(
        absl::StrCat("URI \"", shown, "\": only data: and relative URIs are read"));
  }
  const auto path = percent_decode(uri);
  if (!path) return absl::InvalidArgumentError(absl::StrCat("URI \"", shown, "\": bad escape"));
  for (const char c : *path) {
    if (static_cast<unsigned char>(c) < 0x20 || c == '\\' || c == 0x7F) {
      return absl::InvalidArgumentError(
          absl::StrCat("URI \"", shown, "\": control character or backslash"));
    }
  }
  if (!is_utf8(*path)) {
    return absl::InvalidArgumentError(absl::StrCat("URI \"", shown, "\": not UTF-8"));
  }
  if (path->front() == '/') {
    return absl::InvalidArgumentError(absl::StrCat("URI \"", shown, "\": the path is absolute"));
  }
  if (has_parent_segment(*path)) {
    return absl::InvalidArgumentError(
        absl::StrCat("URI \"", shown, "\": the path leaves the scene's directory (\"..\")"));
  }
  return *path;
}

}  // namespace tessera::render
