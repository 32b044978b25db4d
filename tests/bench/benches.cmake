# Benchmarks: built with the tests, run by hand (each folder has a run.sh).
if(TESSERA_WITH_GRPC)
  include(bench/coordinator/sources.cmake)
endif()
include(bench/store/sources.cmake)
include(bench/accel/sources.cmake)
include(bench/coverage/sources.cmake)
