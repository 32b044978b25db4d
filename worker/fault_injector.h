#pragma once

#include "worker/agent/units/fault_hooks.h"

namespace CLI {
class App;
}  // namespace CLI

namespace tessera::worker {

/// Faults that a build of the worker can inject. This class injects none and is what the shipped
/// worker uses; tests/e2e/faults derives another for test builds.
class FaultInjector {
 public:
  FaultInjector() = default;
  FaultInjector(const FaultInjector&) = delete;
  FaultInjector& operator=(const FaultInjector&) = delete;
  virtual ~FaultInjector() = default;

  /// Adds the options of the faults to the worker's command line and to that of its renderer
  /// process.
  virtual void add_options(CLI::App& /*worker*/, CLI::App& /*renderer*/) {}

  /// Returns the hooks for the parsed options. The injector must outlive them.
  virtual agent::FaultHooks hooks() { return {}; }
};

}  // namespace tessera::worker
