#include <csignal>
#include <cstdio>
#include <string>

#include "absl/strings/escaping.h"
#include "rpc/settings_message.h"
#include "worker/agent/agent.h"
#include "worker/renderer/renderer.h"
#include "worker/config.h"
#include "worker/inspect/accelerator_table.h"
#include "worker/inspect/inspect_report.h"
#include "worker/inspect/solid_check.h"

namespace {

constexpr int kWrongInput = 2, kRefused = 3;

int work(const tessera::agent::AgentOptions& options) {
  const absl::Status status = tessera::agent::run_agent(options);
  if (status.ok()) return 0;
  std::fprintf(stderr, "tessera-worker: %s\n", std::string(status.message()).c_str());
  return kRefused;
}

/// Adds the table of acceleration structures to a report.
void add_accelerators(const tessera::worker::InspectConfig& config,
                      const tessera::contract::RenderSettings& settings,
                      const tessera::render::Scene& scene, tessera::render::InspectReport& report) {
  const auto table = tessera::render::measure_accelerators(scene, settings, {config.accelerator});
  if (table.ok()) {
    report.extras.emplace_back("accelerators", to_json(*table));
  } else {
    report.findings.push_back({report.scene,
                               {tessera::render::Problem::Severity::error, "accelerators",
                                std::string(table.status().message())}});
  }
}

int inspect(const tessera::worker::InspectConfig& config) {
  tessera::render::InspectRequest request;
  request.scene = config.scene;
  request.environment = config.environment;
  if (!config.settings_hex.empty()) {
    tessera::v1::RenderSettings message;
    if (!message.ParseFromString(absl::HexStringToBytes(config.settings_hex))) return kWrongInput;
    auto settings = tessera::contract::from_message(message);
    if (!settings.ok()) return kWrongInput;
    request.settings = *std::move(settings);
  }
  request.examine = [&](const auto& scene, auto& report) {
    if (config.accelerators || !config.accelerator.empty()) {
      add_accelerators(config, request.settings, scene, report);
    }
    if (config.self_intersections) {
      report.extras.emplace_back("self_intersections", tessera::render::overlap_report(scene));
    }
  };
  const auto report = tessera::render::inspect_scene(request);
  const std::string text = to_json(report);
  std::fwrite(text.data(), 1, text.size(), stdout);
  return report.has_errors() ? kWrongInput : 0;
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
  if (const auto* wanted = std::get_if<tessera::worker::InspectConfig>(&config)) {
    return inspect(*wanted);
  }
  return work(std::get<tessera::agent::AgentOptions>(config));
}
