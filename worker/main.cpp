#include <csignal>
#include <cstdio>
#include <string>

#include "worker/agent/agent.h"
#include "worker/agent/renderer.h"
#include "worker/config.h"

namespace {

constexpr int kWrongInput = 2, kRefused = 3;

int work(const tessera::agent::AgentOptions& options) {
  const absl::Status status = tessera::agent::run_agent(options);
  if (status.ok()) return 0;
  std::fprintf(stderr, "tessera-worker: %s\n", std::string(status.message()).c_str());
  return kRefused;
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  const auto parsed = tessera::worker::parse_command_line(argc, argv);
  if (const int* exit_code = std::get_if<int>(&parsed)) return *exit_code;
  const auto& config = std::get<tessera::worker::Config>(parsed);
  if (const auto* renderer = std::get_if<tessera::agent::RendererOptions>(&config)) {
    return tessera::agent::run_renderer(*renderer);
  }
  return work(std::get<tessera::agent::AgentOptions>(config));
}
