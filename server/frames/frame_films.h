#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/unit.h"
#include "server/film/film_cache.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Opens the film of frames over their committed blocks, which it reads back from the store. Calls
/// about one frame are made by one thread at a time.
class FrameFilms {
 public:
  FrameFilms(FarmState& farm, const Store& store)
      : farm_(farm), store_(store), cache_(farm.options().film_memory_bytes) {}

  /// The film of all open frames.
  FilmCache& cache() { return cache_; }
  const FilmCache& cache() const { return cache_; }

  /// Opens a frame unless its job is gone, again if its film is out of date (JobFilm::revision).
  /// Returns whether it opened it.
  bool open(const FrameKey& key);
  /// Returns whether the frame's film is open and up to date.
  bool is_current(const FarmView& farm, const FrameKey& key) const;
  /// Drops the film of a frame.
  void close(const FrameKey& key);
  /// Returns the frame's units whose blocks could not be read since the last call: they are
  /// damaged.
  std::vector<contract::Unit> take_damaged(const FrameKey& key);

 private:
  absl::StatusOr<contract::FilmBlock> read_block(const std::string& job_id,
                                                 const contract::Unit& unit);
  ReferenceReader reference_reader(const JobSpec& spec, std::int32_t frame);

  FarmState& farm_;
  const Store& store_;
  FilmCache cache_;
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::map<FrameKey, std::int64_t> revisions_ ABSL_GUARDED_BY(mutex_);  // of open frames
  std::map<FrameKey, std::vector<contract::Unit>> damaged_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
