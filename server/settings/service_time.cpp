#include "server/settings/service_time.h"

#include <cstdint>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {

constexpr char kName[] = "us";

absl::Status ServiceTime::load(FarmChange& change) {
  const auto rows = store_.settings().read(SettingKind::service_time);
  if (!rows.ok()) return rows.status();
  const auto row = rows->find(kName);
  std::int64_t served_us = 0;
  if (row != rows->end() && absl::SimpleAtoi(row->second, &served_us))
    change.continue_service(served_us);
  return absl::OkStatus();
}

void ServiceTime::write(FarmChange& change) {
  pipeline_.post_write(
      [this, served_us = change.served_us()] {
        return store_.settings().save(SettingKind::service_time,
                                      {{kName, absl::StrCat(served_us)}});
      },
      [this](const absl::Status& status) {
        if (status.ok()) return;
        farm_.log(LogLevel::error, absl::StrCat("time of service: ", status.ToString()));
      });
}

}  // namespace tessera::server
