# Tests of this folder (see ../CMakeLists.txt).
tessera_test(NAME contract KIND unit
  SOURCES unit/proto/digest_test.cpp unit/proto/error_estimate_test.cpp
          unit/proto/film_block_test.cpp unit/proto/hilbert_test.cpp
          unit/proto/image_metrics_test.cpp unit/proto/pass_schedule_test.cpp
          unit/proto/stopping_rule_test.cpp unit/proto/tile_grid_test.cpp
  LINKS tessera::contract)
tessera_test(NAME log KIND unit SOURCES unit/proto/log_test.cpp LINKS tessera::log)
if(TESSERA_WITH_GRPC)
  include(unit/proto/style.cmake)
  tessera_test(NAME settings KIND unit SOURCES unit/proto/settings_test.cpp LINKS tessera::channel)
endif()
