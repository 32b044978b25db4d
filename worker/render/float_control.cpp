#include "worker/render/float_control.h"

#include <immintrin.h>
#include <link.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera::render {
namespace {

constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040, kRounding = 0x6000;

/// How many libraries the process had ever loaded when this thread was last found right; 0 before.
/// Per thread, as the register is: a library that one thread loads changes the mode of that thread
/// and of those that it starts.
unsigned long long& loads_at_last_check() {
  thread_local unsigned long long loads = 0;
  return loads;
}

/// Number of objects that the dynamic linker has loaded since the process began.
unsigned long long count_loads() {
  unsigned long long loads = 0;
  ::dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t /*size*/, void* count) {
        *static_cast<unsigned long long*>(count) = info->dlpi_adds;
        return 1;  // the first object tells it
      },
      &loads);
  return loads;
}

/// Paths of the loaded objects, in the order in which they were loaded.
std::vector<std::string> loaded_objects() {
  std::vector<std::string> names;
  ::dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t /*size*/, void* all) {
        static_cast<std::vector<std::string>*>(all)->emplace_back(info->dlpi_name);
        return 0;
      },
      &names);
  return names;
}

}  // namespace

bool has_ieee_floats() {
  if ((_mm_getcsr() & (kFlushToZero | kDenormalsAreZero | kRounding)) != 0) return false;
  loads_at_last_check() = count_loads();
  return true;
}

std::string describe_float_fault() {
  const unsigned mode = _mm_getcsr();
  const unsigned long long before = loads_at_last_check(), now = count_loads();
  std::vector<std::string> names = loaded_objects();
  // Those loaded last; a few older ones as well if one loaded since has been unloaded.
  const auto recent =
      static_cast<std::size_t>(std::min<unsigned long long>(now - before, names.size()));
  names.erase(names.begin(), names.end() - static_cast<std::ptrdiff_t>(recent));
  names.erase(std::remove(names.begin(), names.end(), ""), names.end());  // the program itself
  const char* since = before == 0 ? "the mode was never right; libraries of the process: "
                                  : "libraries loaded since the thread's last check: ";
  return absl::StrCat("the thread's floating-point mode is not the IEEE 754 default (MXCSR 0x",
                      absl::Hex(mode), (mode & kRounding) != 0 ? ", changes rounding" : "",
                      (mode & (kFlushToZero | kDenormalsAreZero)) != 0 ? ", flushes denormals" : "",
                      "), so that pixels would differ; ", since,
                      names.empty() ? "none" : absl::StrJoin(names, ", "));
}

void require_ieee_floats(const char* place) {
  if (has_ieee_floats()) return;
  std::fprintf(stderr, "tessera: %s, %s\n", place, describe_float_fault().c_str());
  std::abort();
}

}  // namespace tessera::render
