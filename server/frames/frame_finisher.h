#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "contract/film_block.h"
#include "contract/unit.h"
#include "server/commit/commit_pipeline.h"
#include "server/film/film_cache.h"
#include "server/frames/finished_frame.h"
#include "server/frames/frame_films.h"
#include "server/settings/budgets.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"
#include "server/sync/strand_queue.h"

namespace tessera::server {

/// A committed unit to merge; without a block, only its commit is noted.
struct FilmUpdate {
  std::string job_id;
  contract::Unit unit;
  std::optional<contract::FilmBlock> block;
  std::int64_t revision = 0;  // of the job's film when it was committed
  /// Memory of the block, released when the update is destroyed. Owners: copies of the update.
  std::shared_ptr<void> memory;
};

/// Takes frames from their committed blocks to finished images, and has units rendered again whose
/// blocks are damaged. Merges and writes images on the film threads, those of a frame in order;
/// writes rows on the writer thread.
class FrameFinisher final : public EffectHandler {
 public:
  FrameFinisher(FarmState& farm, Store& store, CommitPipeline& pipeline, Budgets& budgets);

  /// The film threads' tasks, by frame.
  StrandQueue<FrameKey>& tasks() { return tasks_; }
  const StrandQueue<FrameKey>& tasks() const { return tasks_; }
  FrameFilms& films() { return films_; }
  const FrameFilms& films() const { return films_; }

  /// Merges a committed unit.
  void merge(FilmUpdate update);
  /// Finishes a frame unless units or audits are missing or it contains units of a faulty worker.
  void finish_if_complete(FarmChange& change, Job& job, std::int32_t frame);
  /// Finishes frames that were completed while the job was not active, and opens the others.
  void catch_up(FarmChange& change, Job& job);
  /// Drops the film of the job's frames.
  void close_frames(const Job& job);
  /// Opens a frame, or opens it again if it is out of date, and passes its targets to the
  /// scheduler. Returns false if there was nothing to do or its job is gone. In a task of the
  /// frame.
  bool open(const FrameKey& key);
  /// Has workers render units again that were dropped from the store, because their blocks were
  /// unreadable or wrong. `reset_pass_targets`: also withdraws the pass targets derived from them.
  /// On the writer thread.
  void forget(const FrameKey& key, const std::vector<contract::Unit>& units,
              bool reset_pass_targets);
  void carry_out(FarmChange& change, const Effects& effects) override;

 private:
  void open_started(FarmChange& change, Job& job);
  void merge_now(const FilmUpdate& update);
  void decide(const FrameKey& key);
  void look(const FrameKey& key);
  std::shared_ptr<const JobSpec> find_spec(const FrameKey& key) const;
  absl::Status pass_targets(const FrameKey& key);
  void handle(const FrameKey& key, const absl::Status& status);
  void estimate(const FrameKey& key);
  void close(const FrameKey& key);
  void finish(const FrameKey& key);
  bool may_record(const FrameKey& key, std::int64_t revision);
  void finish_again(const FrameKey& key);
  void tell_finished(const FrameKey& key, const std::string& owner);
  void note_finished(const FrameKey& key, const FinishedFrame& frame);
  bool redo_damaged(const FrameKey& key, const absl::Status& status);
  void redo(const FrameKey& key, const std::vector<contract::Unit>& units);
  void fail(const FrameKey& key, const absl::Status& status);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  Budgets& budgets_;
  FrameFilms films_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::map<FrameKey, Time> last_estimate_ ABSL_GUARDED_BY(mutex_);
  StrandQueue<FrameKey> tasks_;
};

}  // namespace tessera::server
