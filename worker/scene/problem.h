#pragma once

#include <string>

namespace tessera::render {

/// One thing wrong with, or notable about, a file.
struct Problem {
  enum class Severity { error, warning, note };
  Severity severity = Severity::error;
  std::string element;  // e.g. "accessors[12]", "extensionsRequired"; empty: the file
  std::string message;  // fault, value, and what to do
};

}  // namespace tessera::render
