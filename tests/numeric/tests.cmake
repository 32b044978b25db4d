# Tests of this folder (see ../CMakeLists.txt).
tessera_test(NAME render_bsdf KIND numeric SOURCES numeric/render_bsdf.cpp LINKS tessera::render)
tessera_test(NAME geometry KIND numeric
  SOURCES numeric/agreement_test.cpp numeric/geometry_scenes.cpp numeric/geometry_scenes.h
    numeric/watertight_test.cpp
  LINKS tessera::render)
# Headers only, with the contraction that everything else forbids.
tessera_test(NAME contraction KIND numeric SOURCES numeric/contraction_test.cpp)
target_compile_options(numeric_contraction_test PRIVATE -ffp-contract=fast)
