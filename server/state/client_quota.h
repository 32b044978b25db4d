#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "absl/status/status.h"
#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Upper bounds of what a job needs.
struct JobSize {
  std::int64_t store_bytes = 0;  // blocks of all frames, and the images
  double samples = 0;            // pixels × samples, over all frames
};
JobSize max_job_size(const JobSpec& spec);

/// Limits of what a client may use; 0: unlimited. The server's options --client-QUOTA set them.
struct ClientQuota {
  double jobs = 0;                 // unfinished
  double gigasamples = 0;          // pixels × samples of unfinished jobs, 10⁹
  double gb = 0;                   // store that unfinished jobs may need
  double stored_gb = 0;            // scene files and results, and what unfinished jobs may need
  double streams = 8;              // open at once
  double event_subscriptions = 4;  // streams of events among them
  double connections = 100;        // open at once
  double concurrent_calls = 4;     // in progress at once, without streams
  double calls = 500;              // per second
  double upload_gb = 50;           // per hour
};

/// A kind of quota.
struct QuotaKind {
  const char* name;             // of the option --client-NAME
  double ClientQuota::*member;  // the limit
  const char* what;             // with "is limited to 4 WHAT" in messages
  const char* advice;           // what a client over the limit can do
};
/// All kinds, in the order of ClientQuota's members.
inline constexpr std::array<QuotaKind, 10> kQuotaKinds = {{
    {"jobs", &ClientQuota::jobs, "unfinished jobs", "wait for jobs to finish, or cancel some"},
    {"gigasamples", &ClientQuota::gigasamples, "billion samples of unfinished jobs",
     "wait for jobs to finish, cancel some, or ask for fewer samples"},
    {"gb", &ClientQuota::gb, "GB of store that unfinished jobs may need",
     "wait for jobs to finish, cancel some, or split the job"},
    {"stored-gb", &ClientQuota::stored_gb,
     "GB of scene files, results and what unfinished jobs may need", "fetch and remove ended jobs"},
    {"streams", &ClientQuota::streams, "open streams", "close one, such as a watch or a transfer"},
    {"event-subscriptions", &ClientQuota::event_subscriptions, "event subscriptions",
     "end one, such as a webhook or `tessera events --follow`"},
    {"connections", &ClientQuota::connections, "open connections",
     "end some programs that use this certificate, or let one make their calls"},
    {"concurrent-calls", &ClientQuota::concurrent_calls, "calls in progress",
     "retry later, and make fewer calls at the same time"},
    {"calls", &ClientQuota::calls, "calls per second", "retry later, and call less often"},
    {"upload-gb", &ClientQuota::upload_gb, "GB uploaded per hour", "retry later"},
}};
/// Returns the kind of a member. Requires a member of ClientQuota.
const QuotaKind& quota_kind(double ClientQuota::*member);

/// The quotas of all clients.
struct ClientQuotas {
  ClientQuota defaults = {};
  std::map<std::string, ClientQuota> by_client = {};  // of clients that have others

  const ClientQuota& of(const std::string& client) const {
    const auto found = by_client.find(client);
    return found == by_client.end() ? defaults : found->second;
  }
  /// Returns the largest limit of a kind; 0: unlimited for some client.
  double largest(double ClientQuota::*member) const;
};

/// Returns ResourceExhausted with the quota, its limit, the use and what to do.
absl::Status over_quota(const std::string& client, const QuotaKind& kind, double used,
                        double limit);

/// A client's use of its quotas, as far as its jobs and files count.
struct OwnerUse {
  std::int64_t jobs = 0;                // unfinished
  double store_bytes = 0, samples = 0;  // what these may need
  double kept_bytes = 0;                // scene files, and results of ended jobs
  void add(const JobSpec& spec);
  OwnerUse& operator+=(const OwnerUse& other);
  /// Returns the use in the quota's unit; 0 for kinds that are not about jobs and files.
  double of(const QuotaKind& kind) const;
};

/// Checks that `client` with this use may have another job. Errors: ResourceExhausted, see
/// over_quota(); `refused` is set to the kind unless it is null.
absl::Status check_quota(const ClientQuota& quota, OwnerUse use, const JobSpec& spec,
                         const QuotaKind** refused = nullptr);

}  // namespace tessera::server
