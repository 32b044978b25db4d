#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/request/render_options.h"

namespace tessera::client {

/// What the report of a reference says of it.
struct BenchReference {
  /// Its settings, all that decide which image is expected: not sample counts, seed, tile or what
  /// else the file holds. Scene and environment, which a report does not know as files, are empty.
  RenderOptions render;
  std::string sky;  // name of its environment's file; empty: it had none
  std::string scene_sha256;
  std::int64_t seed = 0;
  double relmse = 0;  // its own, as the report estimates it
};

/// Reads tessera.report/1. Errors: InvalidArgument, what the text lacks to be the report of a
/// finished render of one frame, with an estimate of its error.
absl::StatusOr<BenchReference> read_reference_report(std::string_view text);

/// The first `count` of 1, 2, 3, … without the reference's: with its seed a render has its samples,
/// and so its errors.
std::vector<std::int64_t> bench_seeds(int count, std::int64_t reference_seed);

}  // namespace tessera::client
