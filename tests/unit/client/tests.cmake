# Tests of this folder (see ../CMakeLists.txt).
