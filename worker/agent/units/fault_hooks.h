#pragma once

#include <functional>
#include <string>
#include <vector>

#include "contract/unit.h"
#include "worker/agent/units/unit_queue.h"

namespace tessera::agent {

/// Points at which a test build of the worker injects faults. Hooks that are empty, as all are in
/// the shipped worker, do nothing.
struct FaultHooks {
  /// Called in the renderer process, on the rendering thread, before a unit is rendered.
  std::function<void(const contract::Unit&)> before_unit;
  /// Called on the agent's thread with each rendered block, before its digest is computed; may
  /// change the bytes.
  std::function<void(std::string& block)> block_rendered;
  /// Called on the agent's thread for each block to deliver; returns the blocks to send in its
  /// place, at least one.
  std::function<std::vector<UnitQueue::Block>(UnitQueue::Block)> blocks_to_send;
  /// Command-line arguments that set up the same hooks in a renderer process started later.
  std::vector<std::string> renderer_arguments;
};

}  // namespace tessera::agent
