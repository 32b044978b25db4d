# CPack: Debian packages (`cpack -G DEB`) and a tarball for Debian 12 (`cpack -G TZST`), from the
# components of TesseraInstall.cmake. Run in build/release after a build.
set(CPACK_GENERATOR "DEB;TZST")
set(CPACK_PACKAGE_NAME tessera)
set(CPACK_PACKAGE_VENDOR "Tessera")
set(CPACK_PACKAGE_CONTACT "The Tessera authors <tessera@example.org>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Render farm for glTF scenes")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_PACKAGE_FILE_NAME tessera-${PROJECT_VERSION}-linux-x86_64)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL cli server worker)
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/cmake/TesseraPackagesGenerator.cmake)

# Staged by DESTDIR, so that the installation knows its final prefix.
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_CLI_PACKAGE_NAME tessera-cli)
set(CPACK_DEBIAN_SERVER_PACKAGE_NAME tessera-server)
set(CPACK_DEBIAN_WORKER_PACKAGE_NAME tessera-worker)
set(CPACK_COMPONENT_CLI_DESCRIPTION
"render farm for glTF scenes - command line
 Submits glTF scenes to a farm, follows and fetches jobs, and compares images.
 With tessera-server and tessera-worker installed it also renders on this
 machine, with the same pixels.")
set(CPACK_COMPONENT_SERVER_DESCRIPTION
"render farm for glTF scenes - coordinator
 Splits frames into tiles, leases them to workers, and merges the results into
 OpenEXR images. Keeps everything it has acknowledged across crashes. Contains
 the webhook that posts farm events as well.")
set(CPACK_COMPONENT_WORKER_DESCRIPTION
"render farm for glTF scenes - worker
 Path-traces tiles of glTF scenes for a coordinator in a sandboxed process, with
 the same bits on every machine.")
# `tessera submit` and `inspect` run `tessera-worker inspect` to read scenes; `render` starts a server too.
set(CPACK_DEBIAN_CLI_PACKAGE_DEPENDS tessera-worker)
set(CPACK_DEBIAN_CLI_PACKAGE_RECOMMENDS tessera-server)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS adduser)
set(CPACK_DEBIAN_WORKER_PACKAGE_DEPENDS adduser)
# Part of 1.0, of the same version as the worker; the worker now reads Radiance images itself.
set(CPACK_DEBIAN_WORKER_PACKAGE_CONFLICTS tessera-radiance)
set(CPACK_DEBIAN_WORKER_PACKAGE_REPLACES tessera-radiance)

foreach(component IN ITEMS server worker)
  string(TOUPPER ${component} upper)
  set(scripts ${PROJECT_BINARY_DIR}/packages/${component})
  file(MAKE_DIRECTORY ${scripts})
  set(control "")
  foreach(script IN ITEMS postinst prerm postrm)
    configure_file(${PROJECT_SOURCE_DIR}/deploy/packages/${component}.${script} ${scripts}/${script} COPYONLY)
    list(APPEND control ${scripts}/${script})
  endforeach()
  configure_file(${PROJECT_SOURCE_DIR}/deploy/packages/${component}.conffiles ${scripts}/conffiles COPYONLY)
  set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA "${control};${scripts}/conffiles")
endforeach()

include(CPack)
