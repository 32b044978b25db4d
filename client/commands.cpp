#include "client/commands.h"

namespace tessera::client {

void add_all_commands(CLI::App& app, Invocation& invocation) {
  add_watch_command(app, invocation);
}

}  // namespace tessera::client
