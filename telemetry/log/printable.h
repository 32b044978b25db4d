#pragma once

#include <string>
#include <string_view>

namespace tessera {

/// Returns whether UTF-8 text contains a control character: a line break, NUL, an escape sequence
/// of a terminal (C0, DEL and C1 of ISO 6429).
bool has_control_characters(std::string_view text);

/// Returns UTF-8 text on one line, without control characters: each is written as \n, \t or \xNN.
std::string printable(std::string_view text);

}  // namespace tessera
