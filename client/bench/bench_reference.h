#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/request/render_options.h"

namespace tessera::client {

/// Contents of a reference's report.
struct BenchReference {
  /// Settings that determine the expected image, without sample counts, seed and tile size. Scene
  /// and environment are empty: a report has no paths.
  RenderOptions render;
  std::string environment;  // file name of the environment map; empty: none
  std::string scene_sha256;
  std::int64_t seed = 0;
  double relmse = 0;  // the reference's own, as estimated in the report
};

/// Parses a document of schema tessera.report/1. Errors: InvalidArgument, it is not the report of a
/// finished render of one frame with an error estimate.
absl::StatusOr<BenchReference> read_reference_report(std::string_view text);

/// Returns the first `count` of 1, 2, 3, … without the reference's seed, whose samples are
/// correlated with the reference.
std::vector<std::int64_t> bench_seeds(int count, std::int64_t reference_seed);

}  // namespace tessera::client
