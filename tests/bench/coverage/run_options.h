#pragma once

#include <cstdint>
#include <string>

#include "contract/render_settings.h"

namespace CLI {
class App;
}

namespace tessera::bench {

/// Scene, frame settings, seeds and samples of the reference of a run.
struct RunOptions {
  std::string scene;
  contract::RenderSettings settings;
  int seeds = 400;
  std::uint32_t first_seed = 1;
  std::int32_t reference_spp = 8192;
};

/// Adds the options, and sets the settings to 64 x 64 pixels in tiles of 16 with `max_spp` samples
/// and a depth of 6. `options` must outlive the parsing.
void add_run_options(CLI::App& app, RunOptions& options, std::int32_t max_spp);

}  // namespace tessera::bench
