#include "tests/bench/coverage/run_options.h"

#include <CLI/CLI.hpp>

namespace tessera::bench {

void add_run_options(CLI::App& app, RunOptions& options, std::int32_t max_spp) {
  contract::RenderSettings& settings = options.settings;
  settings.width = settings.height = 64;
  settings.tile = 16;
  settings.max_depth = 6;
  settings.spp = max_spp;
  app.add_option("scene", options.scene)->required();
  app.add_option("--max-spp", settings.spp);
  app.add_option("--seeds", options.seeds)->check(CLI::Range(2, 1'000'000));
  app.add_option("--first-seed", options.first_seed);
  app.add_option("--reference-spp", options.reference_spp)->check(CLI::Range(64, 1 << 20));
  app.add_option("--width", settings.width);
  app.add_option("--height", settings.height);
  app.add_option("--tile", settings.tile);
  app.add_option("--max-depth", settings.max_depth);
  settings.guiding = true;  // as by default in jobs with a target error
  app.add_flag_callback(
      "--no-guiding", [&settings] { settings.guiding = false; },
      "Do not guide paths by photons, neither those of the reference");
  app.add_option("--environment", settings.environment, "A file in the scene's folder");
}

}  // namespace tessera::bench
