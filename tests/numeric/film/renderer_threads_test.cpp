// Hard case 79: a library that changes the floating-point mode of a thread of the renderer.

#include <dlfcn.h>
#include <gtest/gtest.h>

#include "worker/renderer/render_pool.h"

namespace tessera::testing {
namespace {

constexpr const char* kFlushingLibrary = TESSERA_FLUSHING_LIBRARY;

TEST(FloatControlDeathTest, RendererThreadsAreChecked) {
  EXPECT_DEATH(
      {
        ::dlopen(kFlushingLibrary, RTLD_NOW | RTLD_LOCAL);
        const agent::RenderPool pool(1);  // its threads inherit the mode
      },
      "when a thread of the renderer starts, .*tessera_flushing_library.so");
  EXPECT_DEATH(
      {
        agent::RenderPool pool(1);
        pool.submit([] { ::dlopen(kFlushingLibrary, RTLD_NOW | RTLD_LOCAL); });
      },
      "after a task of the renderer, .*tessera_flushing_library.so");
}

}  // namespace
}  // namespace tessera::testing
