#include "worker/program.h"

int main(int argc, char** argv) {
  tessera::worker::FaultInjector no_faults;
  return tessera::worker::run_program(argc, argv, no_faults);
}
