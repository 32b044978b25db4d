// Hard case 79: a library that changes the floating-point mode.

#include "worker/render/float_control.h"

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <immintrin.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "tests/support/scene/plain_scene.h"
#include "worker/accel/accelerator.h"

namespace tessera::testing {
namespace {

constexpr const char* kLibrary = TESSERA_FLUSHING_LIBRARY;

/// Loads the library on the calling thread, whose mode it changes.
void* load_library() {
  void* library = ::dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << ::dlerror();
  return library;
}

/// An empty scene that loads the library at its first ray, in the middle of a unit.
class LoadingAccelerator final : public render::Accelerator {
 public:
  bool closest_hit(const render::Ray& /*ray*/, const render::HitFilter* /*filter*/,
                   render::Hit& /*hit*/) const override {
    if (!loaded_.exchange(true)) load_library();
    return false;
  }
  bool any_hit(const render::Ray& /*ray*/, const render::HitFilter* /*filter*/) const override {
    return false;
  }
  std::size_t memory_bytes() const override { return 0; }

 private:
  mutable std::atomic<bool> loaded_ = false;
};

/// Runs `act` on a thread of its own, since the mode belongs to the thread.
template <typename Act>
void on_own_thread(const Act& act) {
  std::thread(act).join();
}

TEST(FloatControlDeathTest, ChangedModeAborts) {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040, kRoundUp = 0x4000;
  for (const unsigned mode : {kFlushToZero, kDenormalsAreZero, kRoundUp}) {
    EXPECT_DEATH(
        {
          _mm_setcsr(_mm_getcsr() | mode);
          render_picture(empty_scene(), small_settings(8, 8, 4));
        },
        mode == kRoundUp ? "changes rounding" : "flushes denormals");
  }
}

TEST(FloatControlDeathTest, LibraryLoadedBeforeUnitIsNamed) {
  EXPECT_DEATH(
      {
        render_picture(empty_scene(), small_settings(8, 8, 4));
        load_library();
        render_picture(empty_scene(), small_settings(8, 8, 4));
      },
      "before some pixels of a unit, .*flushes denormals.*since the thread's last check: "
      "[^ ]*tessera_flushing_library.so\n");
}

TEST(FloatControlDeathTest, LibraryLoadedInsideUnitIsNamed) {
  const render::TraceOptions tracing(render::best_isa(), [](const render::Scene& /*scene*/) {
    return std::make_unique<LoadingAccelerator>();
  });
  EXPECT_DEATH(render_picture(empty_scene(), small_settings(8, 8, 4), tracing),
               "after some pixels of a unit, .*flushes denormals.*since the thread's last check: "
               "[^ ]*tessera_flushing_library.so\n");
}

TEST(FloatControl, OlderLibrariesAreNotNamed) {
  on_own_thread([] {
    EXPECT_TRUE(render::has_ieee_floats());
    void* const library = load_library();
    EXPECT_FALSE(render::has_ieee_floats());
    const std::string fault = render::describe_float_fault();
    EXPECT_NE(fault.find(kLibrary), std::string::npos) << fault;
    EXPECT_EQ(fault.find("libc.so"), std::string::npos) << fault;
    ::dlclose(library);
  });
  on_own_thread([] {
    void* const library = load_library();
    _mm_setcsr(_mm_getcsr() & ~0x8040u);
    EXPECT_TRUE(render::has_ieee_floats());  // the library was loaded before this check
    _mm_setcsr(_mm_getcsr() | 0x8000u);
    EXPECT_FALSE(render::has_ieee_floats());
    const std::string fault = render::describe_float_fault();
    EXPECT_NE(fault.find("since the thread's last check: none"), std::string::npos) << fault;
    ::dlclose(library);
  });
}

TEST(FloatControl, CheckOfOneThreadHidesNoLibraryOfAnother) {
  std::atomic<int> step = 0;
  std::thread loader([&] {
    EXPECT_TRUE(render::has_ieee_floats());
    void* const library = load_library();
    step = 1;
    while (step != 2) std::this_thread::yield();
    EXPECT_FALSE(render::has_ieee_floats());
    const std::string fault = render::describe_float_fault();
    EXPECT_NE(fault.find(kLibrary), std::string::npos) << fault;
    ::dlclose(library);
  });
  while (step != 1) std::this_thread::yield();
  EXPECT_TRUE(render::has_ieee_floats()) << "the mode belongs to the thread that loads";
  step = 2;
  loader.join();
}

TEST(FloatControl, UncheckedThreadNamesEveryLibrary) {
  on_own_thread([] {
    void* const library = load_library();
    const std::string fault = render::describe_float_fault();
    for (const char* name : {"never right", "libc.so", kLibrary}) {
      EXPECT_NE(fault.find(name), std::string::npos) << fault;
    }
    ::dlclose(library);
  });
}

}  // namespace
}  // namespace tessera::testing
