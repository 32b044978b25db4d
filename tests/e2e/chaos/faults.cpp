// Faults for the shipped programs: a library for LD_PRELOAD that interposes functions of the C
// library. The programs have no code for this.
//
//   FAULTS_CONTROL  file with a mapped Control, which the test changes while the program runs
//   FAULTS_LOG      file to which a line is appended at a power cut
//   FAULTS_STORE    directory of the store, whose disk has faults; unset: only the clock has
//   FAULTS_CUT_AT   number of the change or sync of the store at which the power is cut
//
// A power cut removes everything that is not synced: bytes of files without a later fdatasync, and
// names whose directory was not synced. This is the worst case that POSIX allows; DiskModel of the
// unit tests covers partial loss. The process ends by SIGKILL.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace {

/// Shared with the test: native 64-bit integers in this order.
struct Control {
  // Written by the test.
  std::int64_t clock_offset_s;  // added to the wall clock
  std::int64_t sync_us;         // additional duration of each sync
  std::int64_t disk_full;       // not 0: writes fail
  // Written by this library: how often each took effect, and changes and syncs of this process.
  std::int64_t clock_answers, slow_syncs, full_answers, steps;
};

template <typename Function>
Function* next_of(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

/// Defines `next`, the C library's function of this name.
#define NEXT(name) static auto* const next = next_of<decltype(::name)>(#name)

int raw_open(const char* path, int flags) {
  NEXT(open64);
  return next(path, flags | O_CLOEXEC, 0600);
}
void raw_pwrite(int file, const std::string& bytes, off_t offset) {
  NEXT(pwrite64);
  (void)!next(file, bytes.data(), bytes.size(), offset);
}
void raw_truncate(int file, off_t size) {
  NEXT(ftruncate64);
  (void)!next(file, size);
}
void raw_rename(const std::string& from, const std::string& to) {
  NEXT(rename);
  next(from.c_str(), to.c_str());
}
void raw_remove(const std::string& path) {
  NEXT(remove);
  next(path.c_str());
}

bool exists(const char* path) {
  struct stat info {};
  return ::lstat(path, &info) == 0;
}

using FileKey = std::pair<dev_t, ino_t>;

/// The disk of one store, and the changes that a power cut would undo.
class Disk {
 public:
  Disk() {
    const auto variable = [](const char* name) {
      const char* value = std::getenv(name);
      return std::string(value == nullptr ? "" : value);
    };
    root_ = variable("FAULTS_STORE");
    log_path_ = variable("FAULTS_LOG");
    cut_at_ = std::atoll(variable("FAULTS_CUT_AT").c_str());
    const int file = raw_open(variable("FAULTS_CONTROL").c_str(), O_RDWR);
    if (file < 0) return;
    void* memory = ::mmap(nullptr, sizeof(Control), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory != MAP_FAILED) control_ = static_cast<Control*>(memory);
    ::close(file);
    if (!root_.empty()) control_->steps = 0;
  }

  Control& control() { return *control_; }
  std::recursive_mutex& mutex() { return mutex_; }

  /// Returns whether `path` is in the store and on disk, which SQLite's shared memory is not.
  bool owns(const std::string& path) const {
    if (root_.empty() || path.compare(0, root_.size(), root_) != 0) return false;
    if (path.size() > root_.size() && path[root_.size()] != '/') return false;
    return path.size() < 4 || path.compare(path.size() - 4, 4, "-shm") != 0;
  }

  /// Returns the path of a descriptor if it is in the store, else nothing.
  std::string path_of(int file) const {
    if (root_.empty()) return {};
    char target[PATH_MAX];
    const std::string link = "/proc/self/fd/" + std::to_string(file);
    const ssize_t length = ::readlink(link.c_str(), target, sizeof target);
    std::string path(target, length > 0 ? static_cast<std::size_t>(length) : 0);
    return owns(path) ? path : std::string();
  }

  // The rest requires the mutex.

  /// Called before a change or sync, at which the power may be cut instead.
  void step(const char* what, const std::string& path) {
    if (++control_->steps == cut_at_) cut(what, path);
  }

  /// Records that a name in a directory has changed.
  void remember_name(const std::string& path, std::function<void()> undo) {
    if (cut_at_ > 0) undos_.push_back({path.substr(0, path.rfind('/')), {}, std::move(undo)});
  }

  /// Called before bytes [offset, offset + count) of a file are written or truncated.
  void remember_bytes(int file, const std::string& path, off_t offset, std::size_t count) {
    struct stat info {};
    if (cut_at_ <= 0 || ::fstat(file, &info) != 0) return;
    const FileKey key(info.st_dev, info.st_ino);
    const auto [handle, is_new] = handles_.try_emplace(key, -1);
    if (is_new) handle->second = raw_open(path.c_str(), O_RDWR);
    const std::size_t there =
        info.st_size > offset ? static_cast<std::size_t>(info.st_size - offset) : 0;
    std::string old(std::min(count, there), '\0');
    if (!old.empty() && ::pread(handle->second, old.data(), old.size(), offset) < 0) old.clear();
    undos_.push_back({"", key, [file = handle->second, offset, old, size = info.st_size] {
                        if (!old.empty()) raw_pwrite(file, old, offset);
                        raw_truncate(file, size);
                      }});
  }

  /// Called before stdio writes a file. Its writes stay inside the C library, so the whole file
  /// counts as unsynced.
  void remember_stream(FILE* stream, const std::string& path) {
    if (stream != nullptr) remember_bytes(::fileno(stream), path, 0, 0);
  }

  /// Gives a file that is about to be unlinked another name outside the store.
  std::string keep(const std::string& path) {
    if (cut_at_ <= 0) return {};
    const std::string kept = root_ + ".lost." + std::to_string(++kept_count_);
    return ::link(path.c_str(), kept.c_str()) == 0 ? kept : std::string();
  }

  /// Called after a successful sync; the changes that it covers are durable.
  void synced(int file, const std::string& path) {
    struct stat info {};
    if (::fstat(file, &info) != 0) return;
    const FileKey key(info.st_dev, info.st_ino);
    const bool is_folder = S_ISDIR(info.st_mode);
    std::erase_if(undos_, [&](const Undo& undo) {
      return is_folder ? undo.folder == path : undo.folder.empty() && undo.file == key;
    });
  }

 private:
  struct Undo {
    std::string folder;  // directory whose sync makes a name durable; empty: bytes of a file
    FileKey file;        // file whose sync makes the bytes durable
    std::function<void()> undo;
  };

  [[noreturn]] void cut(const char* what, const std::string& path) {
    std::size_t names = 0;
    for (auto undo = undos_.rbegin(); undo != undos_.rend(); ++undo) {
      names += undo->folder.empty() ? 0 : 1;
      undo->undo();
    }
    char line[PATH_MAX + 200];
    const int length =
        std::snprintf(line, sizeof line,
                      "power cut at step %lld, before %s of %s: %zu writes and %zu names undone\n",
                      static_cast<long long>(cut_at_), what, path.c_str() + root_.size(),
                      undos_.size() - names, names);
    NEXT(write);
    (void)!next(raw_open(log_path_.c_str(), O_WRONLY | O_APPEND | O_CREAT), line,
                static_cast<std::size_t>(length));
    ::kill(::getpid(), SIGKILL);
    for (;;) ::pause();
  }

  std::string root_, log_path_;
  std::int64_t cut_at_ = 0;  // 0: never
  Control nothing_{};
  Control* control_ = &nothing_;
  std::recursive_mutex mutex_;
  std::vector<Undo> undos_;  // in the order of the changes
  std::map<FileKey, int> handles_;
  int kept_count_ = 0;
};

Disk& disk() {
  static auto* const disk = new Disk;  // outlives every caller
  return *disk;
}

using Lock = std::lock_guard<std::recursive_mutex>;

/// Returns how many of `count` bytes may be written now; -1: none, the disk is full.
ssize_t room_for(std::size_t count) {
  thread_local bool was_cut_short = false;
  Control& control = disk().control();
  if (control.disk_full == 0) {
    was_cut_short = false;
    return static_cast<ssize_t>(count);
  }
  ++control.full_answers;
  if (!was_cut_short && count > 1) {
    was_cut_short = true;
    return static_cast<ssize_t>(count / 2);
  }
  errno = ENOSPC;
  return -1;
}

/// Writes to a file of the store; `write(n)` writes the first n of `count` bytes at `offset`.
template <typename Write>
ssize_t write_to(int file, const std::string& path, std::size_t count, off_t offset,
                 const Write& write) {
  const Lock lock(disk().mutex());
  disk().step("a write", path);
  const ssize_t room = room_for(count);
  if (room < 0) return -1;
  struct stat info {};
  if ((::fcntl(file, F_GETFL) & O_APPEND) != 0 && ::fstat(file, &info) == 0) offset = info.st_size;
  disk().remember_bytes(file, path, offset, static_cast<std::size_t>(room));
  return write(static_cast<std::size_t>(room));
}

template <typename Sync>
int sync(int file, const char* what, const Sync& sync_now) {
  const std::string path = disk().path_of(file);
  if (path.empty()) return sync_now();
  if (const std::int64_t us = disk().control().sync_us; us > 0) {
    ::usleep(static_cast<useconds_t>(us));
    ++disk().control().slow_syncs;
  }
  const Lock lock(disk().mutex());
  disk().step(what, path);
  const int result = sync_now();
  if (result == 0) disk().synced(file, path);
  return result;
}

template <typename Truncate>
int truncate_to(int file, off_t size, const Truncate& truncate_now) {
  const std::string path = disk().path_of(file);
  if (path.empty()) return truncate_now();
  const Lock lock(disk().mutex());
  disk().step("a truncation", path);
  disk().remember_bytes(file, path, size, SIZE_MAX);
  return truncate_now();
}

/// Opens a file and creates it if the flags say so.
template <typename Open>
auto open_or_make(const char* path, bool may_make, const Open& open_now) {
  if (!may_make || !disk().owns(path)) return open_now();
  const Lock lock(disk().mutex());
  const bool is_new = !exists(path);
  if (is_new) disk().step("making", path);
  const auto opened = open_now();
  if (is_new) disk().remember_name(path, [name = std::string(path)] { raw_remove(name); });
  return opened;
}

/// Opens a stream and creates its file if the mode says so.
template <typename Open>
FILE* open_stream(const char* path, const char* mode, const Open& open_now) {
  if (mode[0] == 'r' || !disk().owns(path)) return open_now();
  const Lock lock(disk().mutex());
  FILE* const stream = open_or_make(path, true, open_now);
  disk().remember_stream(stream, path);
  return stream;
}

template <typename Remove>
int remove_name(const char* path, const Remove& remove_now) {
  if (!disk().owns(path)) return remove_now();
  const Lock lock(disk().mutex());
  disk().step("removing", path);
  const std::string kept = disk().keep(path);
  const int result = remove_now();
  if (result == 0 && !kept.empty()) {
    disk().remember_name(path, [kept, name = std::string(path)] { raw_rename(kept, name); });
  }
  return result;
}

/// Adds the offset to a wall-clock time.
void shift(time_t& seconds) {
  Control& control = disk().control();
  if (control.clock_offset_s == 0) return;
  seconds += control.clock_offset_s;
  ++control.clock_answers;
}

}  // namespace

extern "C" {

#define OPEN(name)                                                                              \
  int name(const char* path, int flags, ...) {                                                  \
    NEXT(name);                                                                                 \
    va_list list;                                                                               \
    va_start(list, flags);                                                                      \
    const mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(list, mode_t) : 0;      \
    va_end(list);                                                                               \
    return open_or_make(path, (flags & O_CREAT) != 0, [&] { return next(path, flags, mode); }); \
  }
OPEN(open)
OPEN(open64)

#define FOPEN(name)                                                   \
  FILE* name(const char* path, const char* mode) {                    \
    NEXT(name);                                                       \
    return open_stream(path, mode, [&] { return next(path, mode); }); \
  }
FOPEN(fopen)
FOPEN(fopen64)

ssize_t write(int file, const void* bytes, size_t count) {
  NEXT(write);
  const std::string path = disk().path_of(file);
  if (path.empty()) return next(file, bytes, count);
  return write_to(file, path, count, ::lseek(file, 0, SEEK_CUR),
                  [&](std::size_t part) { return next(file, bytes, part); });
}

ssize_t writev(int file, const iovec* parts, int part_count) {
  NEXT(writev);
  const std::string path = disk().path_of(file);
  if (path.empty()) return next(file, parts, part_count);
  std::size_t count = 0;
  for (int i = 0; i < part_count; ++i) count += parts[i].iov_len;
  return write_to(file, path, count, ::lseek(file, 0, SEEK_CUR), [&](std::size_t part) {
    return part == count ? next(file, parts, part_count)
                         : next(file, parts, 1);  // a short write: the first part only
  });
}

size_t fwrite(const void* bytes, size_t size, size_t count, FILE* stream) {
  NEXT(fwrite);
  if (disk().control().disk_full == 0 || disk().path_of(::fileno(stream)).empty()) {
    return next(bytes, size, count, stream);
  }
  ++disk().control().full_answers;
  errno = ENOSPC;
  return 0;
}

#define PWRITE(name)                                                                    \
  ssize_t name(int file, const void* bytes, size_t count, off_t offset) {               \
    NEXT(name);                                                                         \
    const std::string path = disk().path_of(file);                                      \
    if (path.empty()) return next(file, bytes, count, offset);                          \
    return write_to(file, path, count, offset,                                          \
                    [&](std::size_t part) { return next(file, bytes, part, offset); }); \
  }
PWRITE(pwrite)
PWRITE(pwrite64)

int ftruncate(int file, off_t size) noexcept {
  NEXT(ftruncate);
  return truncate_to(file, size, [&] { return next(file, size); });
}
int ftruncate64(int file, off64_t size) noexcept {
  NEXT(ftruncate64);
  return truncate_to(file, size, [&] { return next(file, size); });
}

int fsync(int file) {
  NEXT(fsync);
  return sync(file, "fsync", [&] { return next(file); });
}
int fdatasync(int file) {
  NEXT(fdatasync);
  return sync(file, "fdatasync", [&] { return next(file); });
}

int rename(const char* from, const char* to) noexcept {
  NEXT(rename);
  if (!disk().owns(to)) return next(from, to);
  const Lock lock(disk().mutex());
  disk().step("renaming to", to);
  const std::string kept = exists(to) ? disk().keep(to) : std::string();
  const int result = next(from, to);
  if (result == 0) {
    disk().remember_name(to, [kept, a = std::string(from), b = std::string(to)] {
      raw_rename(b, a);
      if (!kept.empty()) raw_rename(kept, b);
    });
  }
  return result;
}

int unlink(const char* path) noexcept {
  NEXT(unlink);
  return remove_name(path, [&] { return next(path); });
}
int remove(const char* path) noexcept {
  NEXT(remove);
  return remove_name(path, [&] { return next(path); });
}

int mkdir(const char* path, mode_t mode) noexcept {
  NEXT(mkdir);
  if (!disk().owns(path) || exists(path)) return next(path, mode);
  const Lock lock(disk().mutex());
  disk().step("making", path);
  const int result = next(path, mode);
  if (result == 0) disk().remember_name(path, [name = std::string(path)] { raw_remove(name); });
  return result;
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  NEXT(clock_gettime);
  const int result = next(clock, time);
  if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
    shift(time->tv_sec);
  return result;
}
int gettimeofday(timeval* __restrict time, void* __restrict zone) noexcept {
  NEXT(gettimeofday);
  const int result = next(time, zone);
  if (result == 0) shift(time->tv_sec);
  return result;
}
time_t time(time_t* out) noexcept {
  NEXT(time);
  time_t now = next(nullptr);
  shift(now);
  if (out != nullptr) *out = now;
  return now;
}

}  // extern "C"
