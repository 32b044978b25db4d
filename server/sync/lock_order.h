#pragma once

#include <cstdio>
#include <cstdlib>

#include "absl/base/thread_annotations.h"

namespace tessera::server {

/// A level of the lock order: a thread that holds a lock takes only locks of later levels. So no
/// two locks of one level are ever held together, and threads cannot wait for each other in a
/// circle.
///
/// A level is never locked. It is a lock to clang only so that the order of the levels can be
/// declared, to which each Mutex adds its own place.
class ABSL_LOCKABLE LockLevel {
 public:
  constexpr LockLevel(int number, const char* name) : number_(number), name_(name) {}
  constexpr int number() const { return number_; }
  constexpr const char* name() const { return name_; }

 private:
  int number_;
  const char* name_;
};

/// The lock order of the server, first to last. A mutex of a level is declared
/// ABSL_ACQUIRED_AFTER that level and ABSL_ACQUIRED_BEFORE the next one.
namespace lock_order {

/// Keeps answers in order: CommitPipeline.
inline constexpr LockLevel kAnswers{0, "answers"};
/// Jobs being created: JobAdmission.
inline constexpr LockLevel kAdmission ABSL_ACQUIRED_AFTER(kAnswers){1, "admission"};
/// The film of a frame: FilmCache. Blocks are read back under it, which locks the farm.
inline constexpr LockLevel kFilm ABSL_ACQUIRED_AFTER(kAdmission){2, "film"};
/// A call that is being cancelled, which may run the callbacks of streams: OpenStreams.
inline constexpr LockLevel kCall ABSL_ACQUIRED_AFTER(kFilm){3, "call"};
/// Keeps a worker's stream from being destroyed while it is called.
inline constexpr LockLevel kConnection ABSL_ACQUIRED_AFTER(kCall){4, "connection"};
/// State of a stream of a worker or a client.
inline constexpr LockLevel kStream ABSL_ACQUIRED_AFTER(kConnection){5, "stream"};
/// State of the farm: FarmState.
inline constexpr LockLevel kFarm ABSL_ACQUIRED_AFTER(kStream){6, "farm"};
/// State of a part that posts to the pipeline or checks identities: BlockIntake, AuditOutcomes,
/// the table of open streams.
inline constexpr LockLevel kPart ABSL_ACQUIRED_AFTER(kFarm){7, "part"};
/// Queues of the writer and the answering thread: CommitPipeline.
inline constexpr LockLevel kPipeline ABSL_ACQUIRED_AFTER(kPart){8, "pipeline"};
/// The journal's reader, which hands rows to callers under its lock: Journal.
inline constexpr LockLevel kJournal ABSL_ACQUIRED_AFTER(kPipeline){9, "journal"};
/// All others: queues, budgets, caches, logs. No lock is taken while one of these is held.
inline constexpr LockLevel kLeaf ABSL_ACQUIRED_AFTER(kJournal){10, "leaf"};

}  // namespace lock_order

/// Checks the lock order at run time in builds with assertions; clang does not see locks that a
/// calling function holds. Ends the process if a thread takes a lock out of order.
class LockOrderCheck {
 public:
#ifdef NDEBUG
  explicit constexpr LockOrderCheck(const LockLevel& /*level*/) {}
  void note_locking() const {}
  void note_unlocking() const {}
#else
  explicit constexpr LockOrderCheck(const LockLevel& level) : level_(level) {}
  /// Call before locking.
  void note_locking() const {
    if (held() >> level_.number() != 0) {
      std::fprintf(stderr,
                   "lock order: level \"%s\" taken while locks of levels 0x%x are held; "
                   "see server/sync/lock_order.h\n",
                   level_.name(), held());
      std::abort();
    }
    held() |= 1U << level_.number();
  }
  /// Call before unlocking.
  void note_unlocking() const {
    held() &= ~(1U << level_.number());
  }

 private:
  /// Bit n: the calling thread holds a lock of level n.
  static unsigned& held() {
    thread_local unsigned levels = 0;
    return levels;
  }

  const LockLevel& level_;
#endif
};

}  // namespace tessera::server
