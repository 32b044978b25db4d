#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "contract/unit.h"
#include "worker/accel/layout/isa.h"

namespace tessera::agent {

struct RendererOptions {
  int fd = 3;                     // socket to the agent
  int thread_count = 1;           // units rendered at once
  std::int64_t memory_bytes = 0;  // limit without file mappings; 0: none
  std::int64_t texel_bytes = 0;   // limit of a scene's images in memory; the rest is mapped
  render::Isa isa = render::best_isa();
  /// Called on the rendering thread before each unit, by test builds that inject faults; may be
  /// empty.
  std::function<void(const contract::Unit&)> before_unit;
};

/// Runs the renderer process until the agent closes the socket: loads scenes from descriptors that
/// the agent sends, renders units and returns their blocks. Opens no files and no connections.
/// Returns the exit code.
int run_renderer(const RendererOptions& options);

}  // namespace tessera::agent
