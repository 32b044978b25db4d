# tessera_render_cycles34: tessera_render_once with the BSDF of Blender Cycles 3.4, whose object
# takes the place of extended_bsdf.cpp's in the archive.
add_executable(tessera_render_cycles34
  against_cycles/cycles34_bsdf.cpp ../support/render_once.cpp ../support/folder_reader.cpp
  ../support/folder_reader.h)
target_link_libraries(tessera_render_cycles34 PRIVATE tessera_test_render tessera::image CLI11::CLI11)
