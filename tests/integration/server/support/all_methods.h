#pragma once

#include <google/protobuf/descriptor.h>

#include <vector>

#include "tessera/v1/asset_service.pb.h"
#include "tessera/v1/certificate_service.pb.h"
#include "tessera/v1/farm_service.pb.h"
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

/// Every method of the services of a farm.
inline std::vector<const google::protobuf::MethodDescriptor*> all_methods() {
  std::vector<const google::protobuf::MethodDescriptor*> methods;
  for (const auto* file :
       {v1::CreateJobRequest::descriptor()->file(), v1::UploadAssetRequest::descriptor()->file(),
        v1::WorkRequest::descriptor()->file(), v1::SetLimitRequest::descriptor()->file(),
        v1::RenewCertificateRequest::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int j = 0; j < file->service(i)->method_count(); ++j) {
        methods.push_back(file->service(i)->method(j));
      }
    }
  }
  return methods;
}

}  // namespace tessera::server
