#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include "contract/render_settings.h"
#include "worker/agent/agent.h"
#include "worker/fault_injector.h"
#include "worker/renderer/renderer.h"

namespace tessera::worker {

/// Options of tessera-worker inspect SCENE --json.
struct InspectConfig {
  std::string scene;
  std::string environment;          // environment map to check with the scene; empty: none
  bool json = false;                // required: the only output format
  bool accelerators = false;        // compare the acceleration structures
  std::string accelerator;          // structure to compare with production's; empty: all
  bool self_intersections = false;  // list triangles that intersect
  bool validate = false;            // check the file against the specification
  bool vertex_distances = false;    // list vertices that nearly coincide
  std::string settings_hex;         // serialised v1.RenderSettings, hexadecimal; empty: defaults
};

/// Options of tessera-worker debug-pixel SCENE.
struct DebugPixelConfig {
  std::string scene;
  std::string environment;            // path of the environment map; empty: none
  contract::RenderSettings settings;  // without environment
  std::int32_t x = 0, y = 0, sample = 0;
};

/// The command and its options.
using Config =
    std::variant<agent::AgentOptions, agent::RendererOptions, InspectConfig, DebugPixelConfig>;

/// Parses the command line. Returns an exit code if there is no command to run: 0 after --help and
/// --version, 2 after wrong usage, whose message has been printed. `faults` adds its options.
std::variant<Config, int> parse_command_line(int argc, char** argv, FaultInjector& faults);

}  // namespace tessera::worker
