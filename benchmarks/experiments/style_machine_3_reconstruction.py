"""Experiment 3: recordings resynthesised from their own occupancies and style, against a pooled HMM of hmmlearn.

    python benchmarks/experiments/style_machine_3_reconstruction.py
"""
from dataclasses import replace

import numpy as np
from style_machine_common import LOCOMOTION, body, parse, paths, rms_deg, skeleton

from style_core.hmm import Hmm, log_density, occupancy
from style_core.report import Report
from style_core.style_machine import Settings, analyze, learn, synthesize
from style_core.style_machine.preprocessing import mean_pose
from style_core.style_machine.synthesis import synthesize as render
from style_core.style_machine.trajectory import information, refine_means, trajectory

HELD_OUT = ('07_02', '08_02', '35_02', '16_32', '16_31', '09_02', '16_36', '07_05')


def in_angles(machine, coordinates, motion):
    """A motion of model coordinates (T, D) in joint angles, with the stamps of ``motion``."""
    values = machine.coordinates.decode(coordinates)
    return machine.decoded(motion.joints(machine.joint_names).replace(positions=values))


def refined(machine, motions):
    """RMS of training recordings after the paper's refinement of means, one style at a time."""
    errors = []
    for motion in motions:
        v = machine.styles[motion.name]
        emission = machine.at(v)
        content = analyze(machine, motion).gamma
        target = machine.coordinates.encode(machine.encoded(motion).positions)
        positions, velocities = refine_means(emission, [content], [target - emission.pose])
        better = replace(emission, positions=positions, velocities=velocities)
        errors.append(rms_deg(in_angles(machine, trajectory(information(better), content), motion), motion))
    return errors


def pooled(machine, motions, held_out, seed):
    """RMS with one Gaussian HMM of hmmlearn of the same size, trained on all recordings in the same coordinates.

    Each recording is rebuilt by the same trajectory equations from the pooled model's occupancies; its emissions over
    all joints and velocities come from the same remapping. Once with the recordings' own mean poses given back.
    """
    from hmmlearn.hmm import GaussianHMM

    from style_core.style_machine import emission as em
    c = machine.coordinates
    q = c.leading

    def own(motion):
        posed = machine.encoded(motion)
        return c.encode(posed.positions) - c.encode(mean_pose(posed))

    data = [own(motion) for motion in motions]
    peer = GaussianHMM(machine.n_states, 'full', n_iter=50, random_state=seed, covars_prior=1e-3)
    peer.fit(np.concatenate([x[:, :q] for x in data]), [len(x) for x in data])
    trans = np.nan_to_num(peer.transmat_)
    trans = np.where(trans.sum(axis=1, keepdims=True) > 0, trans, 1.0 / len(trans))
    model = Hmm(peer.startprob_, trans / trans.sum(axis=1, keepdims=True), peer.means_,
                peer.covars_ + 1e-4 * np.eye(q))

    def content(x):
        return occupancy(log_density(x[:, :q], model.means, model.covs), model.start, model.trans)

    parts = []
    for x in data:
        found = content(x)
        parts.append(em.velocity_moments(x, found.gamma, found.counts, q))
    noise = machine.settings.resolution ** 2 * float(c.variances[:q].mean())
    emission = em.remap_generic([em.add_statistics(parts)], np.zeros(c.basis.shape[0]), 1e-9, (noise, noise * 1e-2))

    def error(motion):
        x = own(motion)
        pose = c.encode(mean_pose(machine.encoded(motion)))
        return rms_deg(in_angles(machine, trajectory(information(emission), content(x).gamma) + pose, motion), motion)

    return [error(motion) for motion in motions], [error(motion) for motion in held_out]


def main():
    args = parse(__doc__, states=24)
    report = Report('style_machine_3_reconstruction', 'Resynthesis of recordings',
                    'python benchmarks/experiments/style_machine_3_reconstruction.py', args.seed,
                    paths([*LOCOMOTION, *HELD_OUT]))
    training = [name for name in LOCOMOTION if name not in HELD_OUT]
    motions, held_out = [body(name) for name in training], [body(name) for name in HELD_OUT]
    machine = learn(motions, Settings(states=args.states, seed=args.seed), skeleton=skeleton(), dof=len(motions))
    peer_in, peer_out = pooled(machine, motions, held_out, args.seed)
    rows = []
    for motion, peer, fitted in zip(motions, peer_in, refined(machine, motions)):
        found = analyze(machine, motion)
        rows.append([motion.name, rms_deg(render(machine, found.gamma, motion.name), motion),
                     rms_deg(render(machine, found.path, motion.name), motion), fitted, peer,
                     float(np.degrees(motion.positions.std(axis=0).mean()))])
    rows.append(['mean', *np.mean([row[1:] for row in rows], axis=0)])
    report.table('training', ['recording', 'occupancies', 'state sequence only', 'refined means', 'pooled HMM',
                              'spread of the recording'], rows, 'Training recordings: RMS error, degrees a joint')
    rows, worst = [], None
    for motion, peer in zip(held_out, peer_out):
        found = analyze(machine, motion)
        projected = synthesize(machine, found.gamma, found.v)
        emission = found.emission
        path = in_angles(machine, trajectory(information(emission), found.gamma), motion)
        posed = in_angles(machine, trajectory(information(
            replace(machine.at(found.v), pose=emission.pose)), found.gamma), motion)
        rows.append([motion.name, found.nearest, rms_deg(projected, motion),
                     rms_deg(posed, motion), rms_deg(path, motion),
                     rms_deg(synthesize(machine, found.gamma, found.nearest), motion), peer,
                     float(np.degrees(motion.positions.std(axis=0).mean()))])
        per_joint = np.degrees(np.sqrt(((projected.positions - motion.positions) ** 2).mean(axis=0)))
        worst = per_joint if worst is None else worst + per_joint
    rows.append(['mean', '', *np.mean([row[2:] for row in rows], axis=0)])
    report.table('held out', ['recording', 'nearest style', 'style coordinates', 'the same, own mean pose',
                              'its own retrained model', 'nearest training style', 'pooled HMM, own mean pose',
                              'spread of the recording'], rows,
                 'Held-out recordings through analysis: RMS error, degrees a joint. The pooled HMM and the retrained '
                 "model are given the recording's own mean pose; style coordinates have to say it.")
    order = np.argsort(-worst)
    report.table('joints', ['joint', 'RMS (deg)'], [[machine.joint_names[k], float(worst[k] / len(held_out))]
                                                    for k in [*order[:8], *order[-4:]]],
                 'Held out, by joint (style coordinates): the worst eight and the best four')
    print(report.write(args.output))


if __name__ == '__main__':
    main()
