#include "telemetry/log/printable.h"

#include <algorithm>
#include <cstddef>

namespace tessera {
namespace {

constexpr char kDigits[] = "0123456789abcdef";

/// Length in bytes of the control character at the beginning of `text`, which is not empty; 0 if
/// there is none. Those of C1, U+0080 to U+009F, have two bytes, of which the first is 0xC2.
std::size_t control_length(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x20 || byte(0) == 0x7F) return 1;
  return byte(0) == 0xC2 && text.size() > 1 && byte(1) >= 0x80 && byte(1) < 0xA0 ? 2 : 0;
}

void append_escape(char control, std::string& out) {
  out += '\\';
  if (control == '\n' || control == '\t') {
    out += control == '\n' ? 'n' : 't';
    return;
  }
  const auto byte = static_cast<unsigned char>(control);
  out += 'x';
  out += kDigits[byte / 16];
  out += kDigits[byte % 16];
}

}  // namespace

bool has_control_characters(std::string_view text) {
  for (; !text.empty(); text.remove_prefix(1)) {
    if (control_length(text) > 0) return true;
  }
  return false;
}

std::string printable(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = control_length(text);
    if (length == 0) out += text.front();
    if (length > 0) append_escape(text[length - 1], out);
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return out;
}

}  // namespace tessera
