#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "contract/unit.h"
#include "worker/accel/layout/isa.h"

namespace tessera::agent {

struct RendererOptions {
  int fd = 3;                     // socket to the agent
  int thread_count = 1;           // units rendered at once
  std::int64_t memory_bytes = 0;  // limit of what is not mapped from files; 0: none
  std::int64_t texel_bytes = 0;   // of a scene's images in memory; the rest is mapped from a file
  render::Isa isa = render::best_isa();
  /// A structure of worker/accel/reference to trace rays with instead, for tests; empty: none.
  std::string accelerator;
  /// Fault injection for tests: dies by SIGSEGV when it takes up this unit.
  std::optional<contract::Unit> crash_on;
};

/// The renderer process: loads scenes from the descriptors it is given, renders units, and answers,
/// until the agent closes the socket. It opens no path and no connection. Returns the exit code.
int run_renderer(const RendererOptions& options);

}  // namespace tessera::agent
