// tessera-webhook posts the events of a farm to an HTTP address. It is a client like any other: the
// server contacts nothing outside the farm and does not wait for slow receivers.
#include "cli/exit_codes.h"
#include "webhook/program.h"

int main(int argc, char** argv) {
  return tessera::cli::end_process(tessera::client::run_webhook(argc, argv));
}
