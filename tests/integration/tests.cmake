# Tests of this folder (see ../CMakeLists.txt).
include(integration/client/tests.cmake)
if(TESSERA_WITH_GRPC)
  tessera_test(NAME server_link KIND integration SOURCES integration/server_link_test.cpp LINKS tessera::agent)
  tessera_test(NAME metrics_listener KIND integration SOURCES integration/metrics_listener_test.cpp
    LINKS tessera::metrics absl::strings)
endif()
include(integration/service/tests.cmake)
