#pragma once

#include <optional>
#include <string>
#include <variant>

#include "worker/agent/agent.h"
#include "worker/renderer/renderer.h"

namespace tessera::worker {

/// tessera-worker inspect SCENE --json.
struct InspectConfig {
  std::string scene;
  std::string environment;          // sky file to check along with it; empty: none
  bool json = false;                // asked for explicitly: the only form there is
  bool accelerators = false;        // measure acceleration structures on it
  std::string accelerator;          // only this one of the reference structures; empty: all
  bool self_intersections = false;  // list triangles that overlap
  std::string settings_hex;  // a serialised v1.RenderSettings in hexadecimal; empty: defaults
};

/// What the command line asks for.
using Config = std::variant<agent::AgentOptions, agent::RendererOptions, InspectConfig>;

/// The parsed command line; an exit code when there is nothing to do: 0 after --help and --version,
/// 2 after wrong usage (the message has been printed).
std::variant<Config, int> parse_command_line(int argc, char** argv);

}  // namespace tessera::worker
