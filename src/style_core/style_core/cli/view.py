"""Look at motion as a body in 3D in the browser.

motion-style view walk.bvh
    a recording: play, scrub, speed, floor, contacts, trails
motion-style view a.amc b.amc --apart 1.5
    two motions side by side; with --apart 0 laid over each other
motion-style view robot.csv --skeleton robot.urdf
    a robot as its file describes it

motion-style view walk.amc --predict MODEL.npz --ahead 0.2
    laid over the recording: what the model predicted 0.2 s before, its band, phase and behaviours
motion-style view --explore MACHINE.npz --skeleton person.asf
    the styles of a style machine: sliders over the style space, named styles to mix, restyled while it plays

The page is served on this machine only, at http://127.0.0.1:8080, unless --host says otherwise: whoever can reach the
address can look at the motion and move the controls.
"""
from pathlib import Path

from style_core.cli.number import Count, Number, Positive
from style_core.cli.recordings import add_recorded_rate, named_recording
from style_core.errors import UsageError
from style_core.formats import skeleton_of
from style_core.skeleton import read_skeleton

__all__ = ['add_arguments', 'run']

#: colour of what was recorded, where a prediction is laid over it
_RECORDED = (27, 31, 36)


def add_arguments(parser, argv):
    """Files, body, address."""
    parser.add_argument('files', nargs='*', metavar='FILE', help='one motion, or two')
    parser.add_argument('--skeleton', metavar='FILE', help='.asf, .bvh or .urdf to draw with (default: the one in or '
                                                           'beside the recording)')
    parser.add_argument('--apart', action=Number, default=1.2, metavar='M',
                        help='how far apart two motions stand; 0 lays them over each other (default: 1.2)')
    parser.add_argument('--hold', action='store_true', help='leave a body whose root is not recorded where it hangs, '
                                                            'instead of walking it over the floor')
    parser.add_argument('--predict', metavar='MODEL', help='lay over the recording what this model predicts')
    parser.add_argument('--explore', metavar='MACHINE', help="try out this style machine's styles, on the content of "
                                                             'FILE or on a random walk')
    parser.add_argument('--seconds', action=Positive, default=8.0, most=120, metavar='S',
                        help='with --explore: length of a random walk (default: 8)')
    parser.add_argument('--ahead', action=Number, least=0, most=1, default=0.2, metavar='S',
                        help='with --predict: how long before (default: 0.2)')
    add_recorded_rate(parser)
    parser.add_argument('--host', default='127.0.0.1', metavar='ADDRESS',
                        help='address to serve on (default: 127.0.0.1, this machine only)')
    parser.add_argument('--port', action=Count, most=65535, default=8080, metavar='N', help='default: 8080')


def run(args):
    """Serve the page until Ctrl-C."""
    from style_core.view.page import need_viser
    need_viser()
    if args.explore and args.predict:
        raise UsageError('--explore and --predict are two pages: give one of them')
    if args.explore:
        return _serve_explorer(args)
    if args.predict and len(args.files) != 1:
        raise UsageError('--predict goes with one recording')
    if not args.files:
        raise UsageError('what should be shown? a motion file, or two')
    if len(args.files) > 2:
        raise UsageError(f'two motions at most are shown together, not {len(args.files)}')
    if args.predict:
        return _serve_prediction(args)
    _serve(args, _recordings(args))


def _recordings(args):
    """(figure, meshes) of each file, on the floor."""
    from style_core.view.recording import COLOURS, body_of, placed
    found = []
    for path, colour in zip(args.files, COLOURS):
        motion = named_recording(path, args.recorded_rate, args.unit)
        skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(path)
        figure, meshes, missing = body_of(motion, skeleton, args.skeleton, colour)
        if missing:
            print(f'{args.skeleton}: {len(missing)} mesh files are not there ({missing[0]}): their links are bare')
        if 'm' in motion.units or not args.hold:
            figure = placed(figure, 'm' in motion.units)
        if found:
            figure = figure.moved(_start(found[0][0], figure, args.apart))
        found.append((figure, meshes))
    return found


def _start(first, second, apart):
    """What moves the second body beside the first one's start."""
    return (*(first.points[0, 0, :2] - second.points[0, 0, :2] + (0, apart)), 0.0)


def _serve(args, bodies):
    from style_core.view.ground import contacts_of
    from style_core.view.page import Actor, Page, opened
    from style_core.view.recording import trail_bodies
    title = ', '.join(Path(path).stem for path in args.files)
    with opened(args.host, args.port, title) as server:
        page = Page(server, max(figure.duration_s for figure, _ in bodies), title)
        for number, (figure, meshes) in enumerate(bodies):
            page.add(Actor(server.scene, f'body_{number}', figure, contacts_of(figure), trail_bodies(figure),
                           meshes=meshes))
        look(page)
        announce(args)
        page.run()


def _serve_prediction(args):
    import numpy as np

    from style_core.cli.predictor_arguments import fitted
    from style_core.predictor_file import read_predictor
    from style_core.view.ground import contacts_of
    from style_core.view.page import Actor, Page, opened
    from style_core.view.prediction_page import PredictionPanel
    from style_core.view.recording import body_of, placed, trail_bodies
    recording = named_recording(args.files[0], args.recorded_rate, args.unit)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(args.files[0])
    hanging, meshes, _ = body_of(recording, skeleton, args.skeleton, _RECORDED)
    recording = recording.joints([name for name in recording.joint_names if name in set(skeleton.channel_names)])
    found = read_predictor(args.predict)
    motion = fitted(recording, found.predictor)
    rooted = 'm' in recording.units
    body = hanging if args.hold and not rooted else placed(hanging, rooted)
    offset = np.nan_to_num(body.points[:, 0] - hanging.points[:, 0])
    with opened(args.host, args.port, recording.name) as server:
        page = Page(server, body.duration_s, recording.name)
        page.add(Actor(server.scene, 'recorded', body, contacts_of(body), trail_bodies(body), meshes=meshes))
        look(page)
        PredictionPanel(page, found, motion, recording, skeleton, offset, args.ahead)
        announce(args)
        page.run()


def _serve_explorer(args):
    from style_core.style_machine import load
    from style_core.view.explorer import of_recording, of_walk
    from style_core.view.explorer_page import ExplorerPanel, first_body
    from style_core.view.ground import contacts_of
    from style_core.view.page import Actor, Page, opened
    from style_core.view.recording import trail_bodies
    if len(args.files) > 1:
        raise UsageError('--explore goes with one recording, or none')
    machine = load(args.explore)
    skeleton = read_skeleton(args.skeleton) if args.skeleton else skeleton_of(args.files[0]) if args.files else None
    if skeleton is None:
        raise UsageError('--explore needs a body to draw: --skeleton FILE (.asf or .bvh)')
    if args.files:
        content = of_recording(machine, named_recording(args.files[0], args.recorded_rate, args.unit))
    else:
        content = of_walk(machine, args.seconds)
    _, figure = first_body(machine, content, 'generic' if content.style is None else content.style, skeleton)
    with opened(args.host, args.port, Path(args.explore).stem) as server:
        page = Page(server, figure.duration_s, Path(args.explore).stem)
        actor = page.add(Actor(server.scene, 'restyled', figure, contacts_of(figure), trail_bodies(figure)))
        look(page)
        ExplorerPanel(page, machine, skeleton, content, actor, args.seconds)
        announce(args)
        page.run()


def look(page):
    """Stand where the bodies fill the view."""
    import numpy as np
    starts = np.concatenate([actor.figure.points[0] for actor in page.actors])
    starts = starts[np.isfinite(starts).all(axis=1)] - page.actors[0].figure.points[0, 0] * (1, 1, 0)
    size = max(float(np.ptp(starts, axis=0).max()), 0.1)
    page.look_at((starts.min(axis=0) + starts.max(axis=0)) / 2, 1.6 * size)


def announce(args):
    """Say where the page is."""
    print(f'showing at http://{args.host}:{args.port} - Ctrl-C ends', flush=True)
