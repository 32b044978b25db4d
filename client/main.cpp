#include "cli/exit_codes.h"
#include "client/program.h"

int main(int argc, char** argv) {
  return tessera::cli::end_process(tessera::client::run_program(argc, argv));
}
