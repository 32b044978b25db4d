#include "server/store/sqlite/disk_reserve.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

DiskReserve::DiskReserve(Filesystem& filesystem, const std::string& folder, std::int64_t bytes)
    : ballast_(filesystem, absl::StrCat(folder, "/ballast"), bytes),
      start_ballast_(filesystem, absl::StrCat(folder, "/ballast.start"), bytes / 4) {}

void DiskReserve::set_up() {
  ballast_.set_up();
  start_ballast_.set_up();
}

bool DiskReserve::give_up_to_start() {
  return start_ballast_.give_up() || ballast_.give_up();
}

absl::Status DiskReserve::write_together(Journal& journal, const std::function<void()>& body) {
  at_any_cost_ = false;
  absl::Status status = journal.write_together(body);
  if (absl::IsResourceExhausted(status) && at_any_cost_ && ballast_.give_up()) {
    status = journal.write_together(body);
  }
  return status;
}

absl::Status DiskReserve::write_at_any_cost(Journal& journal,
                                            const std::function<absl::Status(Database&)>& body) {
  at_any_cost_ = true;
  absl::Status status = journal.write(body);
  if (absl::IsResourceExhausted(status) && ballast_.give_up()) status = journal.write(body);
  return status;
}

}  // namespace tessera::server
