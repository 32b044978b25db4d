# Tests of this folder (see ../CMakeLists.txt).
tessera_test(NAME render_bsdf KIND numeric SOURCES numeric/render_bsdf.cpp LINKS tessera::render)
