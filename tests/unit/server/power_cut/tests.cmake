# The coordinator over a real store, through power cuts.
tessera_test(NAME farm_power_cut KIND unit
  SOURCES unit/server/power_cut/farm_power_cut_test.cpp unit/server/power_cut/farm_on_disk.cpp
          unit/server/store/promises.cpp unit/server/store/sync_sites.cpp
          support/disk_model.cpp support/power_cut.cpp support/recording_vfs.cpp
  LINKS tessera::coordinator SQLite::SQLite3)
