#include "server/store/farm/settings_rows.h"

namespace tessera::server {

absl::Status SettingsRows::save(SettingKind kind, const Settings& settings) {
  const auto number = static_cast<std::int64_t>(kind);
  return journal_.write([&](Database& rows) {
    absl::Status status = rows.run("DELETE FROM settings WHERE kind=?", {number});
    for (const auto& [name, value] : settings) {
      if (!status.ok()) return status;
      status = rows.run("INSERT INTO settings(kind, name, value) VALUES(?, ?, ?)",
                        {number, name, value});
    }
    return status;
  });
}

absl::StatusOr<Settings> SettingsRows::read(SettingKind kind) const {
  Settings settings;
  absl::Status status = journal_.read([&](Database& rows) {
    return rows.each("SELECT name, value FROM settings WHERE kind=?",
                     {static_cast<std::int64_t>(kind)},
                     [&](const SqlRow& row) { settings[row.text(0)] = row.text(1); });
  });
  if (!status.ok()) return status;
  return settings;
}

}  // namespace tessera::server
