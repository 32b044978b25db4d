# Read by CPack once per generator. The tarball contains all components and unpacks into one directory, which
# may be anywhere; its systemd units name /opt/tessera.
if(CPACK_GENERATOR STREQUAL TZST)
  set(CPACK_ARCHIVE_COMPONENT_INSTALL OFF)
  set(CPACK_MONOLITHIC_INSTALL ON)
  set(CPACK_INSTALL_PREFIX /)
  set(CPACK_INCLUDE_TOPLEVEL_DIRECTORY ON)
endif()
