// Simulation of farms with 10 to 10,000 workers: the scheduler of the coordinator, and units that
// take as long as measured ones. Run by tests/bench/scale.sh, which measures them.
//
//   bench_simulated_farm --units FILE --block-bytes N --merge-seconds S --image-seconds S
//     [--film-threads N] [--workers N…]
//
// FILE: CPU seconds of one sample of every pixel, for each unit. Prints a table in Markdown.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "tests/bench/scaling/simulated_farm.h"

namespace tessera::bench {
namespace {

struct Options {
  std::string units;
  MeasuredUnits measured;
  FarmPlan farm;
  JobPlanned job;
  std::vector<std::int32_t> workers = {10, 100, 1000, 3000, 10'000};
};

/// Whether there are any.
bool read_units(Options& options) {
  std::ifstream file(options.units);
  double seconds = 0;
  while (file >> seconds) options.measured.sample_seconds.push_back(seconds);
  return !options.measured.sample_seconds.empty();
}

void print_table(const Options& options) {
  const auto megabytes = options.farm.durable_per_second / 1e6;
  std::printf(
      "| workers | job | efficiency | tail | copies | store, of %.0f MB/s | film threads, of %d "
      "|\n",
      megabytes, options.farm.film_threads);
  std::printf("|---|---|---|---|---|---|---|\n");
  for (const std::int32_t workers : options.workers) {
    FarmPlan farm = options.farm;
    farm.workers = workers;
    const Simulated result = simulate(options.measured, farm, options.job);
    const double efficiency = result.unit_seconds / (result.wall_seconds * workers);
    std::printf("| %d | %.1f s | %.1f %% | %.2f s | %lld | %.0f %% | %.0f %% |\n", workers,
                result.wall_seconds, 100 * efficiency, result.tail_seconds,
                static_cast<long long>(result.copies), 100 * result.ingest_busy,
                100 * result.film_busy);
    std::fflush(stdout);
  }
}

/// Prints the cost of a worker's death half-way through and, the worst case, just before the end.
void print_deaths(const Options& options) {
  std::printf("\n| workers | lost by a death half-way | by one in the tail |\n|---|---|---|\n");
  for (const std::int32_t workers : options.workers) {
    FarmPlan farm = options.farm;
    farm.workers = workers;
    const Simulated whole = simulate(options.measured, farm, options.job);
    const double tail = whole.wall_seconds - whole.tail_seconds / 2;
    std::printf("| %d |", workers);
    for (const double at : {whole.wall_seconds / 2, tail}) {
      farm.death_seconds = at;
      const Simulated with_death = simulate(options.measured, farm, options.job);
      std::printf(" %.2f s |", with_death.wall_seconds - whole.wall_seconds);
    }
    std::printf("\n");
    std::fflush(stdout);
  }
}

int run(int argc, char** argv) {
  Options options;
  CLI::App app{"A farm of many workers on paper"};
  app.add_option("--units", options.units)->required();
  app.add_option("--block-bytes", options.measured.block_bytes)->required();
  app.add_option("--merge-seconds", options.measured.merge_seconds)->required();
  app.add_option("--image-seconds", options.measured.image_seconds)->required();
  app.add_option("--film-threads", options.farm.film_threads)->check(CLI::Range(1, 64));
  app.add_option("--workers", options.workers);
  app.add_option("--frames", options.job.frames);
  app.add_option("--tiles", options.job.tiles);
  app.add_option("--spp", options.job.spp);
  bool with_deaths = false;
  app.add_flag("--deaths", with_deaths, "What the death of a worker costs, too");
  CLI11_PARSE(app, argc, argv);
  if (!read_units(options)) {
    std::fprintf(stderr, "%s: no units\n", options.units.c_str());
    return 2;
  }
  print_table(options);
  if (with_deaths) print_deaths(options);
  return 0;
}

}  // namespace
}  // namespace tessera::bench

int main(int argc, char** argv) {
  return tessera::bench::run(argc, argv);
}
