#include "client/program.h"

int main(int argc, char** argv) {
  return tessera::client::run_program(argc, argv);
}
