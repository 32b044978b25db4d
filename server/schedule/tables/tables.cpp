#include "server/schedule/tables/tables.h"

#include <utility>

namespace tessera::server {

Tables::Tables(StoreIdentity store, SchedulePolicy constants,
               const std::vector<std::string>& roster, Time start)
    : identity(std::move(store)),
      policy(std::move(constants)),
      absences(roster, start + policy.restart_grace),
      ready(policy.share, counts.working(), start),
      outgoing(policy.max_outbox, counts),
      audits(ready),
      leases(workers, counts, ready, outgoing, audits) {}

}  // namespace tessera::server
