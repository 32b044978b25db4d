#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/unit.h"
#include "server/film/film_cache.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Opens the film of frames over their committed blocks, which it reads back from the store. On the
/// film thread, except for cache().
class FrameFilms {
 public:
  FrameFilms(FarmState& farm, const Store& store)
      : farm_(farm), store_(store), cache_(farm.options().film_memory_bytes) {}

  /// The film of all open frames; has a lock of its own, never taken while the farm is locked.
  FilmCache& cache() { return cache_; }
  const FilmCache& cache() const { return cache_; }

  /// Opens a frame unless it is open or its job is gone. Returns whether it opened it.
  bool open(const FrameKey& key);
  /// Returns the units whose blocks could not be read since the last call: they are damaged.
  std::vector<contract::Unit> take_damaged() { return std::exchange(damaged_, {}); }

 private:
  absl::StatusOr<contract::FilmBlock> read_block(const std::string& job_id,
                                                 const contract::Unit& unit);
  ReferenceReader reference_reader(const JobSpec& spec, std::int32_t frame);

  FarmState& farm_;
  const Store& store_;
  FilmCache cache_;
  std::vector<contract::Unit> damaged_;
};

}  // namespace tessera::server
