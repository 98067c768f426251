"""Which module serves which command and which model kind. Modules are imported only when called.

A command module has a docstring (its ``--help`` text), ``add_arguments(parser, argv)`` and ``run(args)``.
A command that works on any model kind finds the kind in the model file and hands over to that kind's module.
"""

COMMANDS = {
    'train': ('learn a model from recordings', 'style_core.cli.train'),
    'convert': ('convert a recording to another format', 'style_core.cli.convert'),
    'split': ('part a table of many recordings into files', 'style_core.cli.split'),
    'info': ('say what a model or motion file holds', 'style_core.cli.info'),
    'predict': ('predict the course of a recording', 'style_core.cli.by_kind'),
    'evaluate': ('measure a model on recordings', 'style_core.cli.by_kind'),
    'synthesize': ('make new motion', 'style_core.cli.by_kind'),
    'analyze': ('find phase, style and content of recordings', 'style_core.cli.by_kind'),
    'fill': ('fill in missing joints of a recording', 'style_core.cli.by_kind'),
    'retarget': ("compute how a person's joints move a robot's", 'style_core.cli.retarget'),
    'effort': ('restyle a recording: freer, stronger, more sudden', 'style_core.cli.effort'),
    'blend': ('blend two motions in space and time', 'style_core.cli.blend'),
    'label': ("collect a person's effort labels", 'style_core.cli.label'),
    'view': ('look at motion as a body in 3D in the browser', 'style_core.cli.view'),
    'bench': ('run the benches on real recordings', 'style_core.cli.bench'),
}

#: ``motion-style train KIND``: kind -> (one-line summary, module path)
TRAINERS = {
    'phase-style': ('phase and style over Gaussian-process bases, for the on-line predictor',
                    'style_core.cli.train_phase_style'),
    'effort': ('fragments labelled by effort, and how efforts mix when fragments are blended',
               'style_core.cli.train_effort'),
    'style-machine': ('stylistic hidden Markov model of unlabelled recordings, for synthesis in any style',
                      'style_core.cli.train_style_machine'),
    'locomotion': ('styles found in unlabelled recordings, aligned cycles, fill-in and blends',
                   'style_core.cli.train_locomotion'),
}

#: kinds that hold an on-line predictor (`style_core.predictor_file`)
_PREDICTING = ('phase-style', 'locomotion', 'style-machine')

#: Commands that work on a model file: command -> {kind: module path}. A command without a kind is not offered.
#: `by_kind` adds the argument MODEL (``args.model``); the kind's module adds the rest and runs. For ``info`` the
#: module has ``describe(header, arrays)`` instead, which returns a dict to show below the header (numbers, words,
#: lists; ``--json`` prints it as it is).
KIND_COMMANDS = {
    'info': {'phase-style': 'style_core.cli.info_phase_style', 'effort': 'style_core.cli.info_effort',
             'style-machine': 'style_core.cli.info_style_machine', 'locomotion': 'style_core.cli.info_locomotion'},
    'predict': dict.fromkeys(_PREDICTING, 'style_core.cli.predict'),
    'evaluate': dict.fromkeys(_PREDICTING, 'style_core.cli.evaluate'),
    'synthesize': {'style-machine': 'style_core.cli.synthesize_style_machine',
                   'locomotion': 'style_core.cli.synthesize_locomotion'},
    'analyze': {'phase-style': 'style_core.cli.analyze_phase_style',
                'style-machine': 'style_core.cli.analyze_style_machine',
                'locomotion': 'style_core.cli.analyze_locomotion'},
    'fill': {'phase-style': 'style_core.cli.fill_phase_style', 'locomotion': 'style_core.cli.fill_locomotion'},
}
