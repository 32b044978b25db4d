# `cmake --install` and CPack: three components, one per Debian package.
#
#   cli        tessera: submits jobs, renders on this machine, manages farms
#   server     tessera-server, the coordinator, and tessera-webhook
#   worker     tessera-worker
#
# Everything is relative to the prefix: the programs find each other beside themselves, so an
# installed tree may be moved.
include(GNUInstallDirs)

install(TARGETS tessera RUNTIME COMPONENT cli)
install(TARGETS tessera-server tessera-webhook RUNTIME COMPONENT server)
install(TARGETS tessera-worker RUNTIME COMPONENT worker)

# Man pages and completions are written by the build (target `manual`) from the tables of --help.
set(manual ${PROJECT_BINARY_DIR}/manual)
install(DIRECTORY ${manual}/man/cli/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT cli)
install(DIRECTORY ${manual}/man/server/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT server)
install(DIRECTORY ${manual}/man/worker/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT worker)
install(FILES ${manual}/completions/tessera.bash COMPONENT cli RENAME tessera
  DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(FILES ${manual}/completions/_tessera COMPONENT cli
  DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
install(FILES ${manual}/completions/tessera.fish COMPONENT cli
  DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)

# systemd units, with the paths of the prefix that is known when installing, and their user.
function(tessera_install_unit component unit)
  install(CODE "
    set(bindir \"\${CMAKE_INSTALL_PREFIX}/bin\")
    if(bindir STREQUAL \"//bin\")
      set(bindir /opt/tessera/bin)
    endif()
    configure_file(\"${PROJECT_SOURCE_DIR}/deploy/systemd/${unit}.in\" \"${PROJECT_BINARY_DIR}/systemd/${unit}\" @ONLY)"
    COMPONENT ${component})
  install(FILES ${PROJECT_BINARY_DIR}/systemd/${unit} DESTINATION lib/systemd/system COMPONENT ${component})
endfunction()
tessera_install_unit(server tessera-server.service)
tessera_install_unit(server tessera-webhook.service)
tessera_install_unit(worker tessera-worker@.service)
foreach(component IN ITEMS server worker)
  install(FILES deploy/systemd/sysusers.conf RENAME tessera-${component}.conf
    DESTINATION lib/sysusers.d COMPONENT ${component})
endforeach()

# Configuration: examples under every prefix. An installation into /usr, as that of a package, has
# them in /etc as well; file(INSTALL) puts DESTDIR before that path.
function(tessera_install_config component file permissions)
  install(FILES deploy/config/${file} DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/tessera-${component}/examples
    COMPONENT ${component})
  install(CODE "
    if(CMAKE_INSTALL_PREFIX STREQUAL \"/usr\")
      file(INSTALL \"${PROJECT_SOURCE_DIR}/deploy/config/${file}\" DESTINATION /etc/tessera
        FILE_PERMISSIONS ${permissions})
    endif()" COMPONENT ${component})
endfunction()
set(everybody "OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ")
tessera_install_config(server server.toml ${everybody})
tessera_install_config(server server.env ${everybody})
tessera_install_config(server webhook.env "OWNER_READ OWNER_WRITE")
tessera_install_config(worker worker.env ${everybody})
install(FILES deploy/config/client.toml DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/tessera-cli/examples
  COMPONENT cli)

# Debian's changelog of a package is compressed, and named for the package's own version.
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
string(TIMESTAMP date "%a, %d %b %Y 00:00:00 +0000" UTC)
file(WRITE ${PROJECT_BINARY_DIR}/packages/changelog
"tessera (${PROJECT_VERSION}-1) bookworm; urgency=medium

  * See CHANGELOG.md for the changes of this version.

 -- The Tessera authors <tessera@example.org>  ${date}
")
execute_process(COMMAND gzip -9nkf changelog WORKING_DIRECTORY ${PROJECT_BINARY_DIR}/packages
  COMMAND_ERROR_IS_FATAL ANY)

foreach(component IN ITEMS cli server worker)
  install(FILES deploy/packages/copyright
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/tessera-${component} COMPONENT ${component})
  install(FILES ${PROJECT_BINARY_DIR}/packages/changelog.gz RENAME changelog.Debian.gz
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/tessera-${component} COMPONENT ${component})
endforeach()
install(DIRECTORY proto/tessera DESTINATION ${CMAKE_INSTALL_DATADIR}/tessera/proto COMPONENT server
  FILES_MATCHING PATTERN "*.proto")
