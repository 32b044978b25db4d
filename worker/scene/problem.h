#pragma once

#include <string>

namespace tessera::render {

/// A fault in a scene file, or a remark about it.
struct Problem {
  enum class Severity { error, warning, note };
  Severity severity = Severity::error;
  std::string element;  // e.g. "accessors[12]", "extensionsRequired"; empty: the file
  std::string message;  // the fault, the value and what to do about it
};

}  // namespace tessera::render
