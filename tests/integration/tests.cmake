# Tests of this folder (see ../CMakeLists.txt).
include(integration/client/tests.cmake)
