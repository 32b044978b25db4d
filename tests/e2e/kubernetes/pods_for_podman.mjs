// Converts manifests to what `podman play kube` 4.3 can run. The StatefulSet becomes a pod with a volume
// claim of its own, under the name of the Service that would lead to it; the Deployment stays. Secrets
// become host directories, because podman makes their files readable by everybody and the programs
// refuse such a key. Arguments with a variable are dropped, because podman does not expand them.
//
//   pods_for_podman.mjs FILE.yaml server|worker DIRECTORY IMAGE
//
// DIRECTORY/SECRET holds the files of each secret, named without its hash; all containers run IMAGE.
import {createRequire} from 'node:module';
import {readFileSync} from 'node:fs';

const require = createRequire(`${process.cwd()}/`);
const YAML = require('yaml');
const [file, part, directory, image] = process.argv.slice(2);
const objects = YAML.parseAllDocuments(readFileSync(file, 'utf8')).map((d) => d.toJS());
const kept = [];
if (part === 'server') {
  const set = objects.find((o) => o.kind === 'StatefulSet');
  const {metadata, spec} = set.spec.template;
  for (const claim of set.spec.volumeClaimTemplates) {
    const name = `${claim.metadata.name}-${set.metadata.name}-0`;
    kept.push({apiVersion: 'v1', kind: 'PersistentVolumeClaim', metadata: {name}, spec: claim.spec});
    spec.volumes.push({name: claim.metadata.name, persistentVolumeClaim: {claimName: name}});
  }
  kept.push({apiVersion: 'v1', kind: 'Pod', metadata: {...metadata, name: set.metadata.name}, spec});
} else {
  kept.push(objects.find((o) => o.kind === 'Deployment'));
}
for (const object of kept) {
  delete object.metadata.namespace;
  const pod = object.spec.template?.spec ?? object.spec;
  for (const volume of pod.volumes ?? []) {
    if (!volume.secret) continue;
    const name = volume.secret.secretName.replace(/-[0-9a-z]{10}$/, '');
    delete volume.secret;
    volume.hostPath = {path: `${directory}/${name}`};
  }
  for (const container of pod.containers ?? []) {
    container.image = image;
    container.imagePullPolicy = 'Never';
    container.args = container.args.filter((argument) => !argument.includes('$('));
  }
}
console.log(kept.map((o) => YAML.stringify(o)).join('---\n'));
