# Tests of this folder (see ../CMakeLists.txt).
include(integration/client/tests.cmake)
if(TESSERA_WITH_GRPC)
  tessera_test(NAME server_link KIND integration SOURCES integration/server_link_test.cpp LINKS tessera::agent)
endif()
include(integration/service/tests.cmake)
