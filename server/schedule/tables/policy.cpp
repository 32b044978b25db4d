#include "server/schedule/tables/policy.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

absl::Status check_client_priority(const SchedulePolicy& policy, std::int32_t priority) {
  if (priority <= policy.client_priority) return absl::OkStatus();
  return absl::PermissionDeniedError(
      absl::StrCat("priority: ", priority, " is above ", policy.client_priority,
                   ", the maximum for clients of this farm; ask an admin"));
}

}  // namespace tessera::server
