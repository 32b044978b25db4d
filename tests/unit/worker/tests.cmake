# Tests of this folder (see ../CMakeLists.txt).
include(support/scene_support.cmake)
include(support/render_support.cmake)
tessera_test(NAME shading KIND unit SOURCES unit/worker/shading_test.cpp LINKS tessera::render)
if(TESSERA_WITH_GRPC)
  tessera_test(NAME agent KIND unit SOURCES unit/worker/agent_test.cpp unit/worker/job_log_test.cpp unit/worker/sandbox_test.cpp unit/worker/unit_queue_test.cpp
    LINKS tessera::agent)
endif()
tessera_test(NAME light KIND unit SOURCES unit/worker/light_tree_test.cpp unit/worker/spherical_rectangle_test.cpp
  unit/worker/spherical_triangle_test.cpp
  LINKS tessera::render)
tessera_test(NAME math KIND unit
  SOURCES unit/worker/math/elementary_test.cpp unit/worker/math/vector_test.cpp
  LINKS tessera::render)
tessera_test(NAME sampling KIND unit
  SOURCES unit/worker/sampling/distribution_test.cpp unit/worker/sampling/gradient_noise_test.cpp unit/worker/sampling/sampler_test.cpp
    unit/worker/sampling/warp_test.cpp
  LINKS tessera::render)
include(unit/worker/scene/tests.cmake)
