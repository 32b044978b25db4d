# Tests of this folder (see ../CMakeLists.txt).
if(TESSERA_WITH_GRPC)
  tessera_test(NAME client KIND unit SOURCES unit/client/bench_test.cpp unit/client/client_test.cpp unit/client/timeline_test.cpp LINKS tessera::client CLI11::CLI11)
  tessera_test(NAME event_relay KIND unit SOURCES unit/client/event_relay_test.cpp LINKS tessera_webhook)
endif()
