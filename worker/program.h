#pragma once

#include "worker/fault_injector.h"

namespace tessera::worker {

/// Runs tessera-worker: parses the command line and executes the command. Returns the exit code.
int run_program(int argc, char** argv, FaultInjector& faults);

}  // namespace tessera::worker
