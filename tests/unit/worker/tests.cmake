# Tests of this folder (see ../CMakeLists.txt).
include(support/scene_support.cmake)
