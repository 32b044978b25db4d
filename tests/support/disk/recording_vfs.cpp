#include "tests/support/disk/recording_vfs.h"

#include <sqlite3.h>

#include <cstdlib>
#include <new>
#include <utility>

namespace tessera::testing {
namespace {

using Kind = DiskEvent::Kind;

/// SQLite's open file; the real file object follows it in the same memory.
struct RecordedFile {
  sqlite3_file base;
  sqlite3_file* real;
  DiskReport* report;
  std::string* path;         // null for files without a name
  bool sync_folder_as_well;  // at the next sync
};

constexpr int kHeaderBytes = (sizeof(RecordedFile) + 15) / 16 * 16;

RecordedFile* recorded(sqlite3_file* file) {
  return reinterpret_cast<RecordedFile*>(file);
}
sqlite3_file* real(sqlite3_file* file) {
  return recorded(file)->real;
}

bool report(sqlite3_file* file, Kind kind, std::int64_t offset = 0, std::string bytes = {}) {
  RecordedFile* const self = recorded(file);
  return self->path == nullptr ||
         (*self->report)({kind, *self->path, "", offset, std::move(bytes)});
}

std::string folder_of(const std::string& path) {
  return path.substr(0, path.find_last_of('/'));
}

int close_file(sqlite3_file* file) {
  const int code = real(file)->pMethods->xClose(real(file));
  delete recorded(file)->path;
  return code;
}

int read_file(sqlite3_file* file, void* out, int count, sqlite3_int64 offset) {
  return real(file)->pMethods->xRead(real(file), out, count, offset);
}

int write_file(sqlite3_file* file, const void* bytes, int count, sqlite3_int64 offset) {
  std::string written(static_cast<const char*>(bytes), static_cast<std::size_t>(count));
  if (!report(file, Kind::write, offset, std::move(written))) return SQLITE_FULL;
  return real(file)->pMethods->xWrite(real(file), bytes, count, offset);
}

int truncate_file(sqlite3_file* file, sqlite3_int64 size) {
  report(file, Kind::truncate, size);
  return real(file)->pMethods->xTruncate(real(file), size);
}

int sync_file(sqlite3_file* file, int /*flags*/) {
  RecordedFile* const self = recorded(file);
  if (!report(file, Kind::sync_file)) return SQLITE_IOERR_FSYNC;
  if (self->sync_folder_as_well) {
    (*self->report)({Kind::sync_folder, folder_of(*self->path), "", 0, ""});
    self->sync_folder_as_well = false;
  }
  return SQLITE_OK;
}

int file_size(sqlite3_file* file, sqlite3_int64* size) {
  return real(file)->pMethods->xFileSize(real(file), size);
}

int lock_file(sqlite3_file* file, int level) {
  return real(file)->pMethods->xLock(real(file), level);
}

int unlock_file(sqlite3_file* file, int level) {
  return real(file)->pMethods->xUnlock(real(file), level);
}

int check_reserved(sqlite3_file* file, int* out) {
  return real(file)->pMethods->xCheckReservedLock(real(file), out);
}

int file_control(sqlite3_file* file, int operation, void* argument) {
  return real(file)->pMethods->xFileControl(real(file), operation, argument);
}

int sector_size(sqlite3_file* file) {
  return real(file)->pMethods->xSectorSize(real(file));
}

int characteristics(sqlite3_file* file) {
  return real(file)->pMethods->xDeviceCharacteristics(real(file));
}

// The shared memory of the log is rebuilt after a crash, so it needs no recording.
int shm_map(sqlite3_file* file, int region, int size, int extend, void volatile** out) {
  return real(file)->pMethods->xShmMap(real(file), region, size, extend, out);
}

int shm_lock(sqlite3_file* file, int offset, int count, int flags) {
  return real(file)->pMethods->xShmLock(real(file), offset, count, flags);
}

void shm_barrier(sqlite3_file* file) {
  real(file)->pMethods->xShmBarrier(real(file));
}

int shm_unmap(sqlite3_file* file, int remove) {
  return real(file)->pMethods->xShmUnmap(real(file), remove);
}

// Version 2: without xFetch, SQLite does not map files into memory, which could not be recorded.
constexpr sqlite3_io_methods kMethods = {
    2,         close_file,  read_file,      write_file,   truncate_file, sync_file,       file_size,
    lock_file, unlock_file, check_reserved, file_control, sector_size,   characteristics, shm_map,
    shm_lock,  shm_barrier, shm_unmap,      nullptr,      nullptr};

}  // namespace

struct RecordingVfs::State {
  sqlite3_vfs vfs{};
  sqlite3_vfs* real = nullptr;
  std::string name;
  DiskReport report;

  static State& of(sqlite3_vfs* vfs) { return *static_cast<State*>(vfs->pAppData); }

  static int open(sqlite3_vfs* vfs, const char* path, sqlite3_file* file, int flags, int* out) {
    State& state = of(vfs);
    RecordedFile* const self = new (file) RecordedFile{};
    self->real = reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + kHeaderBytes);
    self->report = &state.report;
    int existed = 0;
    if (path != nullptr) state.real->xAccess(state.real, path, SQLITE_ACCESS_EXISTS, &existed);
    const int code = state.real->xOpen(state.real, path, self->real, flags, out);
    if (code != SQLITE_OK) return code;  // base.pMethods is null: nothing to close
    self->base.pMethods = &kMethods;
    if (path == nullptr) return code;
    self->path = new std::string(path);
    if (existed == 0) report_event({Kind::create, path, "", 0, ""}, state);
    constexpr int kJournals =
        SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_SUPER_JOURNAL;
    self->sync_folder_as_well = (flags & SQLITE_OPEN_CREATE) != 0 && (flags & kJournals) != 0;
    return code;
  }

  static int remove(sqlite3_vfs* vfs, const char* path, int sync_folder) {
    State& state = of(vfs);
    const int code = state.real->xDelete(state.real, path, 0);
    if (code != SQLITE_OK) return code;
    report_event({Kind::remove, path, "", 0, ""}, state);
    if (sync_folder != 0) report_event({Kind::sync_folder, folder_of(path), "", 0, ""}, state);
    return code;
  }

  static int access(sqlite3_vfs* vfs, const char* path, int flags, int* out) {
    return of(vfs).real->xAccess(of(vfs).real, path, flags, out);
  }

  static int full_path(sqlite3_vfs* vfs, const char* path, int size, char* out) {
    return of(vfs).real->xFullPathname(of(vfs).real, path, size, out);
  }

  static void report_event(DiskEvent event, State& state) { state.report(std::move(event)); }
};

RecordingVfs::RecordingVfs(DiskReport report_to) : state_(std::make_unique<State>()) {
  State& state = *state_;
  state.report = std::move(report_to);
  state.real = sqlite3_vfs_find(nullptr);
  if (state.real == nullptr) std::abort();
  state.name = "recording-" + std::to_string(reinterpret_cast<std::uintptr_t>(&state));
  state.vfs = *state.real;  // randomness, sleep and time stay the real ones
  state.vfs.iVersion = 1;
  state.vfs.szOsFile = kHeaderBytes + state.real->szOsFile;
  state.vfs.pNext = nullptr;
  state.vfs.zName = state.name.c_str();
  state.vfs.pAppData = &state;
  state.vfs.xOpen = State::open;
  state.vfs.xDelete = State::remove;
  state.vfs.xAccess = State::access;
  state.vfs.xFullPathname = State::full_path;
  if (sqlite3_vfs_register(&state.vfs, 0) != SQLITE_OK) std::abort();
}

RecordingVfs::~RecordingVfs() {
  sqlite3_vfs_unregister(&state_->vfs);
}

const std::string& RecordingVfs::name() const {
  return state_->name;
}

}  // namespace tessera::testing
