# The store: one binary, so that SQLite and gtest are linked once.
tessera_test(NAME store KIND unit
  SOURCES unit/server/store/backup_test.cpp unit/server/store/check_test.cpp unit/server/store/power_cut_test.cpp
          unit/server/store/store_test.cpp unit/server/store/store_workers_test.cpp
          unit/server/store/damage_test.cpp unit/server/store/promises.cpp
          unit/server/store/sync_sites.cpp
          support/disk_model.cpp support/failing_disk.cpp support/power_cut.cpp
          support/recording_vfs.cpp
  LINKS tessera::store SQLite::SQLite3)
