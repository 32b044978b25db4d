#include "worker/program.h"

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "absl/strings/escaping.h"
#include "cli/exit_codes.h"
#include "rpc/settings_message.h"
#include "worker/agent/agent.h"
#include "worker/config.h"
#include "worker/inspect/accelerator_table.h"
#include "worker/inspect/debug_pixel.h"
#include "worker/inspect/inspect_report.h"
#include "worker/inspect/near_vertices.h"
#include "worker/inspect/solid_check.h"
#include "worker/renderer/renderer.h"

namespace tessera::worker {
namespace {

using cli::kExitBadInput;

int work(const agent::AgentOptions& options) {
  const absl::Status status = agent::run_agent(options);
  if (status.ok()) return cli::end_process(0);
  std::fprintf(stderr, "tessera-worker: %s\n", std::string(status.message()).c_str());
  return cli::end_process(cli::exit_code(status.code()));
}

/// Adds the comparison of acceleration structures to `report`; a failure becomes a finding.
void add_accelerators(const InspectConfig& config, const contract::RenderSettings& settings,
                      const render::Scene& scene, render::InspectReport& report) {
  const auto table = render::measure_accelerators(scene, settings, {config.accelerator});
  if (table.ok()) {
    report.extras.emplace_back("accelerators", to_json(*table));
  } else {
    report.findings.push_back({report.scene,
                               {render::Problem::Severity::error, "accelerators",
                                std::string(table.status().message())}});
  }
}

int inspect(const InspectConfig& config) {
  render::InspectRequest request;
  request.scene = config.scene;
  request.environment = config.environment;
  request.validate = config.validate;
  if (!config.settings_hex.empty()) {
    v1::RenderSettings message;
    if (!message.ParseFromString(absl::HexStringToBytes(config.settings_hex))) return kExitBadInput;
    auto settings = contract::from_message(message);
    if (!settings.ok()) return kExitBadInput;
    request.settings = *std::move(settings);
  }
  request.examine = [&](const auto& scene, auto& report) {
    if (config.accelerators || !config.accelerator.empty()) {
      add_accelerators(config, request.settings, scene, report);
    }
    if (config.self_intersections) {
      report.extras.emplace_back("self_intersections", render::overlap_report(scene));
    }
    if (config.vertex_distances) {
      report.extras.emplace_back("vertex_distances",
                                 to_json(render::measure_vertex_distances(scene), scene));
    }
  };
  const auto report = render::inspect_scene(request);
  const std::string text = to_json(report);
  std::fwrite(text.data(), 1, text.size(), stdout);
  return report.has_errors() ? kExitBadInput : 0;
}

int debug_pixel(const DebugPixelConfig& config) {
  render::InspectRequest request;
  request.scene = config.scene;
  request.environment = config.environment;
  request.settings = config.settings;
  absl::StatusOr<std::string> text = absl::InvalidArgumentError("the scene cannot be rendered");
  request.examine = [&](const render::Scene& scene, render::InspectReport& /*report*/) {
    text = render::debug_pixel(
        scene, config.settings,
        {config.x, config.y, config.sample, config.settings.frames.front().first});
  };
  const auto report = render::inspect_scene(request);
  for (const auto& finding : report.findings) {
    std::fprintf(stderr, "%s: %s%s%s\n", finding.file.c_str(), finding.problem.element.c_str(),
                 finding.problem.element.empty() ? "" : ": ", finding.problem.message.c_str());
  }
  if (!text.ok()) {
    std::fprintf(stderr, "tessera-worker: %s\n", std::string(text.status().message()).c_str());
    return kExitBadInput;
  }
  std::fputs(text->c_str(), stdout);
  return 0;
}

}  // namespace

int run_program(int argc, char** argv, FaultInjector& faults) {
  std::signal(SIGPIPE, SIG_IGN);
  const auto parsed = parse_command_line(argc, argv, faults);
  if (const int* exit_code = std::get_if<int>(&parsed)) return *exit_code;
  const auto& config = std::get<Config>(parsed);
  if (const auto* renderer = std::get_if<agent::RendererOptions>(&config)) {
    return agent::run_renderer(*renderer);
  }
  if (const auto* request = std::get_if<InspectConfig>(&config)) return inspect(*request);
  if (const auto* request = std::get_if<DebugPixelConfig>(&config)) return debug_pixel(*request);
  return work(std::get<agent::AgentOptions>(config));
}

}  // namespace tessera::worker
