#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "contract/version.h"

namespace tessera::cli {

/// A library that a program uses, with its version.
struct LibraryVersion {
  std::string_view name;
  std::string version;
};

/// Instruction set that all programs are built for; the renderer may use a wider one.
inline constexpr std::string_view kBaselineIsa = "x86-64-v3";

/// Returns the text of --version: program, render contract and instruction set on the first line,
/// libraries on the second.
inline std::string version_text(std::string_view program, std::string_view version,
                                std::string_view isa, const std::vector<LibraryVersion>& libraries,
                                const std::vector<LibraryVersion>& more = {}) {
  std::string text(program);
  text.append(" ").append(version).append(", render contract ");
  text.append(std::to_string(contract::kRenderContract)).append(", isa ").append(isa);
  const char* before = "\n";
  for (const auto* list : {&libraries, &more}) {
    for (const LibraryVersion& library : *list) {
      text.append(before).append(library.name).append(" ").append(library.version);
      before = ", ";
    }
  }
  return text;
}

}  // namespace tessera::cli
