# Tests of this folder (see ../CMakeLists.txt).
include(unit/server/film/tests.cmake)
include(unit/server/store/tests.cmake)
include(unit/server/schedule/tests.cmake)
include(unit/server/coordinator/tests.cmake)
include(unit/server/power_cut/tests.cmake)
include(unit/server/identity/tests.cmake)
